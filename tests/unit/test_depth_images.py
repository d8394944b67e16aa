"""Depth images of a capture: read in every layout, used in place of estimated depth, and exact."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import measured_room
import numpy as np
import pytest
from capture_samples import ply

from nvsim.capture.check import Report, check
from nvsim.capture.depth_images import inverse_depth, read_depth_image
from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.types import Capture
from nvsim.depth.config import DepthConfig
from nvsim.depth.estimate import estimate_depth, estimate_single_frame
from nvsim.depth.files import read_depth
from nvsim.depth.view import Views
from nvsim.errors import InputError
from nvsim.events import ignore_event
from nvsim.mapping.config import MappingConfig
from nvsim.project.config import CaptureConfig
from nvsim.project.graph import context_of
from nvsim.project.project import Project
from nvsim.project.stages import depths as depth_stage
from nvsim.project.stages import floors, imported, mapped, submaps
from nvsim.submaps.split import SubmapConfig
from nvsim.training.synthetic import ROOM, synthetic_room

WIDTH, HEIGHT, COUNT = 160, 120, 16
MANY = 40  # frames with baselines that depth can be estimated from
CONFIG = replace(DepthConfig(), longest_side=160, planes=32, threads=1)


@dataclass
class Layout:
    """How a program writes depth: the key of a frame, the extension, values from meters, more keys at the top."""

    key: str
    extension: str
    values: Callable[[np.ndarray], np.ndarray]
    top: dict[str, float]


def millimeters(depth: np.ndarray) -> np.ndarray:
    return np.rint(1000 * depth).astype(np.uint16)


LAYOUTS = {
    "nerfstudio": Layout("depth_file_path", ".png", millimeters, {}),
    "instant-ngp": Layout(
        "depth_path", ".png", lambda d: np.rint(5000 * d).astype(np.uint16), {"integer_depth_scale": 1 / 5000}
    ),
    "scale factor": Layout(
        "depth_file_path", ".png", lambda d: np.rint(4000 * d).astype(np.uint16), {"depth_unit_scale_factor": 1 / 4000}
    ),
    "float32 array in metres": Layout("depth_file_path", ".npy", lambda d: d.astype(np.float32), {}),
    "float16 array in metres": Layout("depth_file_path", ".npy", lambda d: d.astype(np.float16), {}),
    "array with a last axis": Layout("depth_file_path", ".npy", lambda d: d.astype(np.float32)[..., None], {}),
    "array in millimetres": Layout("depth_file_path", ".npy", lambda d: (1000 * d).astype(np.float32), {}),
    "metres beside the usual factor": Layout(
        "depth_file_path", ".npy", lambda d: d.astype(np.float32), {"depth_unit_scale_factor": 0.001}
    ),
    "float TIFF in metres": Layout("depth_file_path", ".tiff", lambda d: d.astype(np.float32), {}),
    "TIFF in millimetres": Layout("depth_path", ".tif", millimeters, {}),
}


def true_depth(camera_to_world: np.ndarray, camera: object) -> np.ndarray:
    """(H, W) meters along the optical axis to the walls of the synthetic room."""
    rays = camera.rays().astype(np.float64)  # type: ignore[attr-defined]
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = np.max((np.stack([np.zeros(3), ROOM])[:, None, None] - camera_to_world[:3, 3]) / rays, axis=0)
    return leaves.min(axis=-1) * (rays @ camera_to_world[:3, 2])


def write_room(
    folder: Path,
    layout: Layout = LAYOUTS["nerfstudio"],
    size: tuple[int, int] = (WIDTH, HEIGHT),
    noise: float = 0.0,
    kept: slice = slice(None),
    count: int = COUNT,
) -> Path:
    """The synthetic room as transforms.json of `count` frames, with depth images of `size` for those of `kept`."""
    room, rng = synthetic_room(count, WIDTH, HEIGHT, 10), np.random.default_rng(0)
    for sub in ("images", "depth"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    frames = []
    for i, view in enumerate(room.views):
        pose = view.camera.camera_to_world
        cv2.imwrite(str(folder / "images" / f"{i:03d}.png"), view.image[..., ::-1])
        frame = {
            "file_path": f"images/{i:03d}.png",
            "transform_matrix": (pose @ np.diag([1.0, -1, -1, 1])).tolist(),
        }
        depth = true_depth(pose, view.camera.scaled(*size))
        depth = depth * (1 + noise * rng.normal(size=depth.shape))
        if i in range(count)[kept]:
            path = folder / "depth" / f"{i:03d}{layout.extension}"
            if layout.extension == ".npy":
                np.save(path, layout.values(depth))
            else:
                assert cv2.imwrite(str(path), layout.values(depth))
            frame[layout.key] = f"depth/{path.name}"
        frames.append(frame)
    k = room.views[0].camera.intrinsics
    lens = {"fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy, "w": WIDTH, "h": HEIGHT, "camera_model": "OPENCV"}
    path = folder / "transforms.json"
    path.write_text(json.dumps({**lens, **layout.top, "frames": frames}))
    return path


def off_the_walls(points: np.ndarray) -> np.ndarray:
    return np.minimum(np.abs(points), np.abs(points - ROOM)).min(axis=1)


def messages(report: Report, severity: str) -> list[str]:
    return [f.message for f in report.findings if f.severity == severity]


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_depth_of_the_room(tmp_path: Path, name: str) -> None:
    path = write_room(tmp_path, LAYOUTS[name])
    capture = read(path, scale=1.0)
    assert len(capture.depth_of_frames) == COUNT and capture.is_measured
    for i, file in capture.depth_of_frames.items():
        camera = capture.frames[i].camera
        expected = true_depth(camera.camera_to_world, camera)
        assert np.allclose(read_depth_image(file), expected, atol=4e-3)  # of half floats
        assert np.allclose(1 / inverse_depth(file, camera), expected, atol=4e-3)


def test_the_check_counts_depth_images_and_says_what_they_are_for(tmp_path: Path) -> None:
    report = check(write_room(tmp_path))
    assert report.summary is not None and report.summary.depth_images == COUNT
    assert f"{COUNT} of {COUNT} frames have a depth image" in messages(report, "note")
    assert not [m for m in messages(report, "warning") if "cloud" in m or "depth" in m]


def test_a_unit_that_puts_walls_at_the_lens_is_named_and_not_used(tmp_path: Path) -> None:
    path = write_room(tmp_path, LAYOUTS["instant-ngp"])
    tree = json.loads(path.read_text())
    tree["integer_depth_scale"] = 1e-6
    path.write_text(json.dumps(tree))
    report = check(path)
    assert report.capture is not None and not report.capture.depths
    assert any("their unit is wrong" in m for m in messages(report, "warning"))


def lose(path: Path) -> None:
    path.unlink()


def blacken(path: Path) -> None:
    assert cv2.imwrite(str(path), np.zeros((HEIGHT, WIDTH), np.uint16))


def widen(path: Path) -> None:
    assert cv2.imwrite(str(path), np.full((50, 100), 2000, np.uint16))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:200])


def color(path: Path) -> None:
    assert cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lose, "missing"),
        (blacken, "contains no depth"),
        (widen, "does not fit"),
        (cut, "truncated"),
        (color, "one channel"),
    ],
)
def test_a_depth_image_that_cannot_be_used_is_a_warning(tmp_path: Path, harm: object, words: str) -> None:
    path = write_room(tmp_path)
    assert callable(harm)
    harm(tmp_path / "depth" / "003.png")
    report = check(path)
    assert not report.refused and len([m for m in messages(report, "warning") if words in m]) == 1
    assert f"1 of {COUNT} frames have no depth image" in messages(report, "warning")
    assert report.capture is not None and 3 not in report.capture.depth_of_frames


def test_a_damaged_array_is_a_sentence(tmp_path: Path) -> None:
    path = write_room(tmp_path, LAYOUTS["float32 array in metres"])
    file = tmp_path / "depth" / "000.npy"
    file.write_bytes(file.read_bytes()[:-8])
    with pytest.raises(InputError, match="000.npy"):
        read_depth_image(read(path, scale=1.0).depths[0])
    np.save(file, np.array([{"a": 1}], object), allow_pickle=True)
    with pytest.raises(InputError, match="000.npy"):
        read_depth_image(read(path, scale=1.0).depths[0])


def test_depth_images_are_stored_and_change_the_fingerprint(tmp_path: Path) -> None:
    capture = read(write_room(tmp_path), scale=1.0)
    save_capture(capture, tmp_path / "stored")
    again = load_capture(tmp_path / "stored")
    for a, b in zip(capture.depths, again.depths, strict=True):
        assert (a.path, a.lens, a.frame, a.scale, a.unit) == (b.path, b.lens, b.frame, b.scale, b.unit)
        assert np.array_equal(a.camera_to_world, b.camera_to_world)
    assert fingerprint(again) == fingerprint(capture) != fingerprint(replace(capture, depths=()))
    stored = json.loads((tmp_path / "stored" / "capture.json").read_text())
    del stored["depths"]  # as older versions wrote it
    (tmp_path / "stored" / "capture.json").write_text(json.dumps(stored))
    assert load_capture(tmp_path / "stored").depths == ()


def test_the_fused_cloud_lies_on_the_walls(tmp_path: Path) -> None:
    capture = read(write_room(tmp_path), scale=1.0)
    cloud = estimate_depth(capture, tmp_path / "out", CONFIG)
    off = off_the_walls(cloud.points)
    assert len(off) > 10_000 and off.max() < 0.02 and np.quantile(off, 0.999) < 0.01
    walls = cloud.points + 0.3 * cloud.normals
    assert ((walls > 0) & (walls < ROOM)).all(axis=1).mean() > 0.97  # normals face the cameras


def test_noise_and_a_smaller_depth_image_are_tolerated(tmp_path: Path) -> None:
    capture = read(write_room(tmp_path, size=(80, 60), noise=0.015), scale=1.0)
    cloud = estimate_depth(capture, tmp_path / "out", CONFIG)
    off = off_the_walls(cloud.points)
    assert len(off) > 8_000 and np.median(off) < 0.015 and np.quantile(off, 0.99) < 0.1
    known = np.mean([(read_depth(tmp_path / "out", i) > 0).mean() for i in range(COUNT)])
    assert known > 0.9


def test_pixels_between_two_surfaces_are_removed(tmp_path: Path) -> None:
    path = write_room(tmp_path)
    for file in (tmp_path / "depth").iterdir():
        stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        stored[:, 60:80] = 700  # a board before the camera, with a mixed pixel on either side
        for column, beside in ((59, 58), (80, 81)):
            stored[:, column] = (700 + stored[:, beside].astype(int)) // 2
        assert cv2.imwrite(str(file), stored)
    capture = read(path, scale=1.0)
    found = inverse_depth(capture.depths[0], capture.frames[0].camera)
    assert (found[:, [59, 80]] == 0).mean() > 0.95
    assert np.allclose(found[:, 61:79], 1 / 0.7, atol=1e-3) and (found[:, [50, 90]] > 0).all()


def test_frames_without_a_depth_image_are_estimated_beside_the_others(tmp_path: Path) -> None:
    path = write_room(tmp_path, kept=slice(0, MANY - 2), count=MANY)
    report = check(path)
    assert f"2 of {MANY} frames have no depth image" in messages(report, "warning")
    capture = read(path, scale=1.0)
    estimate_depth(capture, tmp_path / "out", CONFIG)
    for i in (0, MANY - 1):
        camera = capture.frames[i].camera
        found, expected = read_depth(tmp_path / "out", i), true_depth(camera.camera_to_world, camera)
        known = found > 0
        assert known.mean() > (0.95 if i == 0 else 0.3)
        assert np.median(np.abs(found - expected)[known]) < (0.005 if i == 0 else 0.05)


def test_masks_leave_no_depth_and_no_evidence(tmp_path: Path) -> None:
    """Estimated depth does not depend on masked pixels, and is 0 there."""
    path = write_room(tmp_path, kept=slice(0, 0), count=MANY)
    tree = json.loads(path.read_text())
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[40:80, 60:110] = False
    assert cv2.imwrite(str(tmp_path / "mask.png"), usable.astype(np.uint8) * 255)
    path.write_text(json.dumps({**tree, "mask_path": "mask.png"}))
    rng, maps = np.random.default_rng(0), []
    for _ in range(2):
        for file in (tmp_path / "images").iterdir():
            image = cv2.imread(str(file))
            assert image is not None
            image[~usable] = rng.integers(0, 255, (np.count_nonzero(~usable), 3))
            cv2.imwrite(str(file), image)
        frames = read(path, scale=1.0).frames
        views = Views(frames, CONFIG.longest_side, CONFIG.threshold, 20)
        maps.append([estimate_single_frame(views, i, CONFIG)[0] for i in (5, 6)])
    for one, other in zip(*maps, strict=True):
        assert np.array_equal(one, other) and (one[usable] > 0).mean() > 0.5 and (one[~usable] == 0).all()


def test_masks_apply_to_depth_images_too(tmp_path: Path) -> None:
    path = write_room(tmp_path)
    tree = json.loads(path.read_text())
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:, :40] = False
    assert cv2.imwrite(str(tmp_path / "mask.png"), usable.astype(np.uint8) * 255)
    path.write_text(json.dumps({**tree, "mask_path": "mask.png"}))
    estimate_depth(read(path, scale=1.0), tmp_path / "out", CONFIG)
    assert all((read_depth(tmp_path / "out", i)[:, :40] == 0).all() for i in range(COUNT))


def test_depth_records_of_kapture_are_drawn_into_their_images(tmp_path: Path) -> None:
    walked = measured_room.poses(8)
    capture = read(measured_room.write_kapture(tmp_path, walked, depth=True), camera_height=1.31)
    assert len(capture.depth_of_frames) == 8
    file, camera = capture.depth_of_frames[2], capture.frames[2].camera
    moved = camera.camera_to_world.copy()
    moved[:3, 3] += 0.05 * moved[:3, 0]
    beside = replace(camera, camera_to_world=moved)
    found, expected = inverse_depth(file, beside), measured_room.depth_image(moved)
    known = found > 0
    error = np.abs(1 / found[known] - expected[known])
    assert known.mean() > 0.9 and np.median(error) < 0.02


def stage(tmp_path: Path, path: Path) -> tuple[Capture, Project, list[str]]:
    told: list[str] = []
    project = Project.create_or_open(tmp_path / "p.nvsim")
    imported.run(project, path, CaptureConfig(scale=1.0), lambda event: told.append(str(event)))
    depth_stage.run(project, "auto", CONFIG, lambda event: told.append(str(event)))
    return project.need_capture(), project, told


def test_a_project_uses_depth_images_like_a_scan(tmp_path: Path) -> None:
    path = write_room(tmp_path)
    (tmp_path / "depth" / "005.png").write_bytes(b"no image")
    capture, project, told = stage(tmp_path, path)
    with project:
        assert len(capture.depth_of_frames) == COUNT - 1 and capture.cloud is None and capture.is_measured
        cloud = project.scan()
        assert cloud is not None and cloud.kind == "depth" and cloud.normals is None
        assert np.quantile(off_the_walls(cloud.points), 0.99) < 0.02
        assert any(f"The depth images of {COUNT - 1} of {COUNT} frames are used" in t for t in told)


def test_depth_images_move_with_the_poses_of_their_frames(tmp_path: Path) -> None:
    from nvsim.project.stages.imported import _depths_at_adjusted_poses

    capture = read(write_room(tmp_path), scale=1.0)
    shift = np.eye(4)
    shift[:3, 3] = [0.01, -0.02, 0.03]
    after = [replace(f, camera_to_world=shift @ f.camera_to_world) for f in capture.frames]
    for depth, frame in zip(_depths_at_adjusted_poses(capture.depths, capture.frames, after), after, strict=True):
        assert np.allclose(depth.camera_to_world, frame.camera_to_world)


@pytest.mark.parametrize("has_scan", [False, True])
def test_only_a_scan_shows_the_map_glass_and_floor_that_no_image_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_scan: bool
) -> None:
    asked: dict[str, object] = {}

    class Asked(Exception):
        pass

    def record(*args: object, **options: object) -> None:
        asked.update(options)
        raise Asked

    path = write_room(tmp_path)
    if has_scan:
        wall = np.random.default_rng(0).uniform(0, ROOM, (30_000, 3))
        wall[np.arange(len(wall)), np.arange(len(wall)) % 3] = 0
        (tmp_path / "scan.ply").write_bytes(ply(wall))
        path.write_text(json.dumps({**json.loads(path.read_text()), "ply_file_path": "scan.ply"}))
    capture, project, _ = stage(tmp_path, path)
    monkeypatch.setattr("nvsim.mapping.builder.build_map", record)
    monkeypatch.setattr(Project, "scene", lambda *args, **options: object())
    with project:
        submaps.run(project, SubmapConfig(), ignore_event)
        floors.run(project, ignore_event)
        with pytest.raises(Asked):
            mapped.run(project, MappingConfig(), ignore_event)
        assert capture.is_measured and capture.is_scanned is asked["scanned"] is has_scan
        assert (context_of(project).possible_glass is None) is has_scan
