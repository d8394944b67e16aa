"""Inject faults into good captures, and count how many `nvsim check` names with the correct cause.

    python tests/benchmarks/injected_faults.py [--data FOLDER] [--building FOLDER] [--frames 60] [--only WORDS]

Captures: the real ones in FOLDER (office_walk, bedroom_colmap, house_walk/kapture; ../shared/data by default) and the
built-in building. Each is reduced to `--frames` consecutive frames and written again in its own format, with one fault.
A fault is named if a finding that the unmodified capture does not have matches the fault's regular expression.
A finding about poses, lenses, or images on an unmodified capture counts as false.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import tyro
from scipy.spatial.transform import Rotation

import nvsim.poses.overlap
import nvsim.poses.refinement
from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.raw import RawCapture, inverse
from nvsim.geometry.lens import Lens
from nvsim.poses.features import MOST, find_features, match_features
from nvsim.poses.pose_checks import find_pose_contradiction, with_poses

REPOSITORY = Path(__file__).resolve().parents[2]
GL = np.diag([1.0, -1.0, -1.0, 1.0])
ROS = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Arguments:
    data: Path = REPOSITORY.parent / "shared" / "data"
    building: Path | None = None
    """A capture of the built-in building, if generated."""
    frames: int = 60
    only: str = ""
    """A regular expression: the faults to inject."""
    captures: str = ""
    """A regular expression: the captures to use."""


@dataclass
class Sample:
    """A capture in memory, to which faults are applied.

    `images` are paths, `poses` (N, 4, 4) are camera to world with OpenCV axes. `listed` has the frames in the file,
    `edits` the changes of image files. `xyzw`, `moved`, and `cloud_listed` control faults of the written files."""

    format: str
    names: list[str]
    images: list[Path]
    poses: np.ndarray
    lens: Lens
    cloud: np.ndarray | None
    metric: bool
    listed: list[int] = field(default_factory=list)
    edits: dict[int, Callable[[Path], None]] = field(default_factory=dict)
    xyzw: bool = False
    moved: bool = False
    cloud_listed: bool = True

    @staticmethod
    def of(raw: RawCapture, frames: int) -> Sample:
        chosen = [f for f in raw.frames if f.camera_to_world is not None and f.lens == raw.frames[0].lens][:frames]
        lens = chosen[0].lens
        assert lens is not None
        cloud = None if raw.cloud is None else raw.cloud.points[:: max(1, len(raw.cloud.points) // 60_000)]
        kind = "kapture" if raw.format == "kapture" else "COLMAP" if raw.format.startswith("COLMAP") else "nerfstudio"
        poses = np.stack([f.camera_to_world for f in chosen if f.camera_to_world is not None])
        names = [f"{i:04d}{f.image_path.suffix}" for i, f in enumerate(chosen)]
        images = [f.image_path for f in chosen]
        return Sample(kind, names, images, poses, lens, cloud, raw.metric, list(range(len(chosen))))

    def write(self, folder: Path) -> Path:
        """Writes the capture to `folder`. Returns the path to check."""
        places = {"nerfstudio": "images", "COLMAP": "images", "kapture": "sensors/records_data/cam"}
        images = folder / places[self.format]
        images.mkdir(parents=True)
        for i, (name, image) in enumerate(zip(self.names, self.images, strict=True)):
            if i in self.edits:
                shutil.copyfile(image, images / name)
                self.edits[i](images / name)
            else:
                os.symlink(image, images / name)
        {"nerfstudio": self._nerfstudio, "COLMAP": self._colmap, "kapture": self._kapture}[self.format](folder)
        if self.moved:
            images.rename(images.with_name("photos"))
        return folder

    def _nerfstudio(self, folder: Path) -> None:
        (fx, fy), (cx, cy) = self.lens.focal, self.lens.principal_point
        k = dict(zip(("k1", "k2", "p1", "p2"), (*self.lens.distortion, 0, 0, 0, 0)[:4], strict=False))
        tree = {"camera_model": "OPENCV", "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, **k}
        tree |= {"w": self.lens.width, "h": self.lens.height, "ply_file_path": "cloud.ply"}
        tree["frames"] = [
            {"file_path": f"images/{self.names[i]}", "transform_matrix": (self.poses[i] @ GL).tolist()}
            for i in self.listed
        ]
        (folder / "transforms.json").write_text(json.dumps(tree))
        self._ply(folder / "cloud.ply")

    def _ply(self, path: Path) -> None:
        if self.cloud is not None and self.cloud_listed:
            head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(self.cloud)}\n"
            head += "property float x\nproperty float y\nproperty float z\nend_header\n"
            path.write_bytes(head.encode() + self.cloud.astype("<f4").tobytes())

    def _row(self, i: int) -> str:
        back = inverse(self.poses[i]) if np.isfinite(self.poses[i]).all() else self.poses[i]
        finite = np.isfinite(back).all()
        q = Rotation.from_matrix(back[:3, :3]).as_quat() if finite else np.full(4, np.nan)
        return " ".join(f"{v:.12g}" for v in (*(q if self.xyzw else np.roll(q, 1)), *back[:3, 3]))

    def _colmap(self, folder: Path) -> None:
        model = folder / "sparse" / "0"
        model.mkdir(parents=True)
        params = " ".join(map(repr, self.lens.params))
        (model / "cameras.txt").write_text(f"1 {self.lens.model} {self.lens.width} {self.lens.height} {params}\n")
        rows = "".join(f"{n + 1} {self._row(i)} 1 {self.names[i]}\n\n" for n, i in enumerate(self.listed))
        (model / "images.txt").write_text(rows)
        points = [] if self.cloud is None else self.cloud
        if self.cloud_listed:
            text = "".join(f"{n + 1} {x} {y} {z} 9 9 9 0.5 1 0\n" for n, (x, y, z) in enumerate(points))
            (model / "points3D.txt").write_text(text)

    def _kapture(self, folder: Path) -> None:
        head, sensors = "# kapture format: 1.1\n", folder / "sensors"
        lens = ", ".join(map(repr, self.lens.params))
        camera = f"cam, cam, camera, {self.lens.model}, {self.lens.width}, {self.lens.height}, {lens}\n"
        (sensors / "sensors.txt").write_text(f"{head}{camera}lidar, lidar, lidar\n")
        poses = "".join(f"{n + 1}, cam, {self._row(i).replace(' ', ', ')}\n" for n, i in enumerate(self.listed))
        (sensors / "trajectories.txt").write_text(f"{head}0, lidar, 1, 0, 0, 0, 0, 0, 0\n{poses}")
        records = "".join(f"{n + 1}, cam, cam/{self.names[i]}\n" for n, i in enumerate(self.listed))
        (sensors / "records_camera.txt").write_text(head + records)
        if self.cloud is not None:
            (sensors / "records_lidar.txt").write_text(f"{head}0, lidar, lidar/cloud.ply\n")
            (sensors / "records_data" / "lidar").mkdir()
            self._ply(sensors / "records_data" / "lidar" / "cloud.ply")


Fault = Callable[[Sample], None]
FAULTS: dict[str, tuple[str, Fault]] = {}


def fault(name: str, pattern: str) -> Callable[[Fault], Fault]:
    def kept(change: Fault) -> Fault:
        FAULTS[name] = (pattern, change)
        return change

    return kept


def placed(name: str, pattern: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Registers a fault that changes all poses (N, 4, 4)."""

    def damage(s: Sample) -> None:
        s.poses = change(s.poses)

    FAULTS[name] = (pattern, damage)


def edited(name: str, pattern: str, change: Callable[[Path], None], every: int = 1) -> None:
    def damage(s: Sample) -> None:
        s.edits = {i: change for i in range(every // 2, len(s.names), every)}

    FAULTS[name] = (pattern, damage)


def lensed(name: str, pattern: str, change: Callable[[Lens], Lens]) -> None:
    def damage(s: Sample) -> None:
        s.lens = change(s.lens)

    FAULTS[name] = (pattern, damage)


def with_params(lens: Lens, focal: float = 1.0, middle: float = 0.0) -> Lens:
    (fx, fy), (cx, cy) = lens.focal, lens.principal_point
    head = (fx * focal, fy * focal) if len(lens.params) - len(lens.distortion) == 4 else (fx * focal,)
    return replace(lens, params=(*head, cx + middle * lens.width, cy, *lens.distortion))


def transposed(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) with transposed rotations."""
    result = poses.copy()
    result[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    return result


def invented(poses: np.ndarray) -> np.ndarray:
    """Random poses (N, 4, 4) in the box of the given ones."""
    rng = np.random.default_rng(1)
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    result[:, :3, :3] = Rotation.random(len(poses), random_state=1).as_matrix()
    result[:, :3, 3] = rng.uniform(poses[:, :3, 3].min(0), poses[:, :3, 3].max(0), (len(poses), 3))
    return result


def circle(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) on a circle that look outward."""
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    for i, t in enumerate(np.linspace(0, 2 * np.pi, len(poses), endpoint=False)):
        ahead, down = np.array([np.cos(t), np.sin(t), 0]), np.array([0, 0, -1.0])
        result[i, :3] = np.column_stack([np.cross(down, ahead), down, ahead, (2 * ahead) + (0, 0, 1.4)])
    return result


def mirrored(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), mirrored along y."""
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return flip @ poses @ flip


def late(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), each replaced by that of the frame 3 later."""
    return poses[np.minimum(np.arange(len(poses)) + 3, len(poses) - 1)]


def outlier(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), one of them far away."""
    result = poses.copy()
    step = np.ptp(poses[:, :3, 3], axis=0).max()
    result[len(poses) // 2, :3, 3] += 30 * step
    return result


def not_finite(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), one of them with NaN."""
    result = poses.copy()
    result[len(poses) // 2, 0, 0] = np.nan
    return result


def tripod(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), all at the position of the first."""
    result = poses.copy()
    result[:, :3, 3] = poses[0, :3, 3]
    return result


placed("axes of OpenGL and OpenCV exchanged", r"Open(CV|GL)'s axes", lambda p: p @ GL)
placed("poses inverted", r"opposite direction", np.linalg.inv)
placed("rotations transposed", r"transposed", transposed)
placed("poses shuffled", r"shuffled", lambda p: p[np.random.default_rng(0).permutation(len(p))])
placed("poses in reverse order", r"reverse", lambda p: p[::-1])
placed("poses invented at random", r"invented", invented)
placed("poses invented on a circle", r"invented", circle)
placed("all poses the identity", r"one place|invented", lambda p: np.tile(np.eye(4), (len(p), 1, 1)))
placed("one pose far away", r"outlier|away from|does not show", outlier)
placed("one pose not a number", r"not a finite|NaN", not_finite)
placed("poses 3 frames late", r"time offset", late)
placed("camera on a tripod", r"one place|parallax", tripod)
lensed("focal length 0.7 times", r"focal length is .* too short", lambda l: with_params(l, 0.7))
lensed("focal length 1.5 times", r"focal length is .* too long", lambda l: with_params(l, 1.5))
lensed("principal point moved", r"principal point", lambda l: with_params(l, middle=0.15))
edited("some images black", r"blank|black", lambda p: repaint(p, lambda i: i * 0), 9)
edited("all images gray", r"blank|constant", lambda p: repaint(p, lambda i: i * 0 + 127))
edited("images upside down", r"turned by 180|upside", lambda p: repaint(p, lambda i: i[::-1, ::-1]))
edited("images mirrored", r"mirrored", lambda p: repaint(p, lambda i: i[:, ::-1]))
edited("images halved without their lens", r"scaled|resize|pixels but", lambda p: repaint(p, lambda i: i[::2, ::2]))
edited(
    "some images cut off", r"truncated", lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]) and None, 9
)
edited("some images missing", r"image is missing|not found", lambda p: p.unlink(), 9)
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"4" * 64 + b"\nsize 123456\n"
edited("images are LFS pointers", r"LFS", lambda p: p.write_bytes(LFS) and None)


def repaint(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Applies `change` to an image file, as (H, W, 3) uint8 BGR."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    assert image is not None and cv2.imwrite(str(path), np.ascontiguousarray(change(image)))


@fault("axes of ROS", r"axes of ROS")
def _(s: Sample) -> None:
    s.poses = s.poses @ ROS @ (GL if s.format == "nerfstudio" else np.eye(4))


@fault("world left-handed", r"left-handed|mirror")
def _(s: Sample) -> None:
    s.poses = mirrored(s.poses) @ (GL if s.format == "nerfstudio" else np.eye(4))


@fault("images of three pairs of frames swapped", r"does not show|another place|swapped")
def _(s: Sample) -> None:
    count = len(s.names)
    for i in (count // 8, count // 5, count // 3):
        j = count - 1 - i
        s.images[i], s.images[j] = s.images[j], s.images[i]


@fault("images cropped, lens kept", r"principal point")
def _(s: Sample) -> None:
    width, height = s.lens.width, s.lens.height
    cut = width // 4
    s.edits = {i: lambda p: repaint(p, lambda pixels: pixels[:, cut:]) for i in range(len(s.names))}
    s.lens = replace(s.lens, width=width - cut, height=height)


def bordered(image: np.ndarray) -> np.ndarray:
    """An image (H, W, 3) with the black border that undistortion leaves: 7 % of its area."""
    rows, columns = (np.linspace(-1, 1, side) for side in image.shape[:2])
    across, down = np.meshgrid(columns, rows)
    black = (np.abs(across) > 0.955 + 0.045 * down**2) | (np.abs(down) > 0.945 + 0.055 * across**2)
    return np.where(black[..., None], 0, image).astype(np.uint8)


@fault("black border of undistorted images", r"black border")
def _(s: Sample) -> None:
    s.edits = {i: lambda p: repaint(p, bordered) for i in range(len(s.names))}


@fault("distortion of the wrong sign, or where there is none", r"distortion")
def _(s: Sample) -> None:
    (fx, fy), (cx, cy) = s.lens.focal, s.lens.principal_point
    if any(abs(k) > 0.01 for k in s.lens.distortion):
        s.lens = replace(s.lens, params=s.lens.params[: -len(s.lens.distortion)] + tuple(-k for k in s.lens.distortion))
    else:
        s.lens = Lens("OPENCV", s.lens.width, s.lens.height, (fx, fy, cx, cy, -0.3, 0.1, 0.0, 0.0))


@fault("everything in millimetres", r"not the meter|unit|scale|span")
def _(s: Sample) -> None:
    s.poses = s.poses.copy()
    s.poses[:, :3, 3] *= 1000
    s.cloud = None if s.cloud is None else s.cloud * 1000


@fault("poses in millimetres, cloud not", r"cloud does not match|another frame or unit")
def _(s: Sample) -> None:
    s.poses = s.poses.copy()
    s.poses[:, :3, 3] *= 1000


@fault("cloud elsewhere", r"cloud does not match")
def _(s: Sample) -> None:
    s.cloud = None if s.cloud is None else s.cloud + np.float32(100)


@fault("cloud missing", r"no point cloud|cloud.*(missing|exist|found)|points3D")
def _(s: Sample) -> None:
    s.cloud_listed = False


@fault(
    "half of the images not listed", r"not (listed|registered|used|read)|of \d+ images|more images|registered|left over"
)
def _(s: Sample) -> None:
    s.listed = s.listed[::2]


@fault("folder of the images renamed", r"image is missing|found by name|images? (were|are) found|looked for")
def _(s: Sample) -> None:
    s.moved = True


@fault("frames listed twice", r"listed twice|(name|record).*twice|more than once")
def _(s: Sample) -> None:
    s.listed = s.listed + s.listed[:3]


@fault("one frame", r"only 1 frame")
def _(s: Sample) -> None:
    s.listed = s.listed[:1]


@fault("quaternions x y z w", r"quaternion")
def _(s: Sample) -> None:
    if s.format == "nerfstudio":  # its files have matrices, as if a converter had used quaternions in the wrong order
        quaternions = Rotation.from_matrix(s.poses[:, :3, :3]).as_quat()
        s.poses = s.poses.copy()
        s.poses[:, :3, :3] = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()
    s.xyzw = True


def remember() -> None:
    """Caches features and matches of images that several faults do not change. The findings do not change."""

    def kept(work: Callable, key: Callable) -> Callable:
        known: dict = {}

        def remembered(*given):  # type: ignore[no-untyped-def]
            found = known.get(words := key(*given))
            return known.setdefault(words, work(*given)) if found is None else found

        return remembered

    def shown(image: np.ndarray, most: int = MOST, usable: np.ndarray | None = None) -> tuple[int, int, int]:
        return hash(image.tobytes()), most, 0 if usable is None else hash(usable.tobytes())

    seen = kept(find_features, shown)
    matched = kept(
        match_features, lambda one, other: (hash(one.descriptors.tobytes()), hash(other.descriptors.tobytes()))
    )
    for module in (nvsim.poses.overlap, nvsim.poses.refinement):
        module.find_features = seen  # type: ignore[attr-defined]
        module.match_features = matched  # type: ignore[attr-defined]


def sentences(path: Path) -> set[str]:
    report = check(path)
    report = with_poses(report)
    found = list(report.findings)
    if (
        not report.refused
        and report.capture is not None
        and (more := find_pose_contradiction(report.capture)) is not None
    ):
        found.append(more)
    return {f"{f.severity}: {f.message} ({f.consequence})" for f in found}


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    remember()
    named: dict[str, dict[str, bool]] = defaultdict(dict)
    false: list[str] = []
    with tempfile.TemporaryDirectory() as scratch:
        sources = [arguments.data / name for name in ("office_walk", "bedroom_colmap", "house_walk/kapture")]
        building = arguments.building
        if building is None:
            from nvsim.building import BuildingConfig, generate

            generate(Path(scratch) / "building", BuildingConfig())
            building = Path(scratch) / "building" / "capture"
        for source in (*sources, building):
            if not re.search(arguments.captures, str(source)):
                continue
            raw = read_raw(source, Findings())
            plain = sentences(Sample.of(raw, arguments.frames).write(Path(scratch) / "plain"))
            shutil.rmtree(Path(scratch) / "plain")
            suspicious = [
                s for s in plain if re.search("poses do not|fit no image|does not show|focal|principal|blank", s)
            ]
            false += [f"{source.name}: {s}" for s in suspicious]
            print(f"\n{source} (unmodified): {len(suspicious)} false\n  " + "\n  ".join(sorted(plain)), flush=True)
            for name, (pattern, damage) in FAULTS.items():
                if not re.search(arguments.only, name):
                    continue
                sample, folder, begun = Sample.of(raw, arguments.frames), Path(scratch) / "damaged", time.process_time()
                damage(sample)
                found = sentences(sample.write(folder))
                shutil.rmtree(folder)
                known = {re.sub(r"[\d.]+", "", s) for s in plain}
                new = sorted(s for s in found if re.sub(r"[\d.]+", "", s) not in known)
                hit = any(re.search(pattern, s) for s in new)
                named[name][source.name] = hit
                print(f"{'named ' if hit else 'MISSED'} {name} ({time.process_time() - begun:.1f} s)", flush=True)
                if not hit or arguments.only:
                    print("         " + "\n         ".join(s[:300] for s in new), flush=True)
    print("\n| fault | " + " | ".join(next(iter(named.values()))) + " |")
    for name, results in named.items():
        print(f"| {name} | " + " | ".join("named" if hit else "missed" for hit in results.values()) + " |")
    for capture in next(iter(named.values())):
        print(f"{capture}: {sum(r[capture] for r in named.values())} of {len(named)} named")
    print(f"false findings on unmodified captures: {len(false)}", *false, sep="\n  ")


if __name__ == "__main__":
    main()
