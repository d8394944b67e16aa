"""Poses and lenses that contradict the images are refused with their cause; right ones are left alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import textured_room as room
from scipy.spatial.transform import Rotation

from nvsim.capture.axes import with_axes
from nvsim.capture.check import Report, check
from nvsim.capture.findings import Finding, Findings
from nvsim.capture.formats import read_raw
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.lens import Lens
from nvsim.poses import overlap
from nvsim.poses.agreement import angles_to_arcs, directions
from nvsim.poses.features import find_features, match_features
from nvsim.poses.pose_checks import contradictions, with_poses

POSES = room.walk()


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return room.write_images(tmp_path_factory.mktemp("images"), POSES)


@pytest.fixture(autouse=True, scope="module")
def remembered() -> Iterator[None]:
    """The same images are matched by many tests: features and matches are computed once."""
    seen: dict[object, object] = {}

    def once(work: Callable[..., object], key: Callable[..., object]) -> Callable[..., object]:
        def kept(*given: object) -> object:
            name = (work, key(*given))
            if name not in seen:
                seen[name] = work(*given)
            return seen[name]

        return kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(overlap, "find_features", once(find_features, lambda image, most: (image.tobytes(), most)))
        pair = once(match_features, lambda one, other: (one.descriptors.tobytes(), other.descriptors.tobytes()))
        patch.setattr(overlap, "match_features", pair)
        yield


def pose_findings(folder: Path, images: list[Path], poses: np.ndarray, **lens: float) -> tuple[Finding, ...]:
    return contradictions(check(room.write_capture(folder, images, poses, **lens)))


def the_error(found: tuple[Finding, ...]) -> Finding:
    (finding,) = found
    assert finding.severity == "error", finding
    return finding


def test_right_poses_have_no_finding(tmp_path: Path, images: list[Path]) -> None:
    assert pose_findings(tmp_path, images, POSES) == ()


def test_opencv_axes_in_a_transforms_json_are_named_and_the_option_mends_them(
    tmp_path: Path, images: list[Path]
) -> None:
    path = room.write_capture(tmp_path, images, POSES @ room.OPENGL)
    report = with_poses(check(path))
    assert report.refused and report.findings[0].severity == "error"
    assert "OpenCV's axes" in report.findings[0].message and report.findings[0].fix == "--axes opencv"
    mended = with_poses(check(path, axes="opencv"))
    assert not mended.refused and contradictions(mended) == ()
    assert contradictions(check(path, axes="ros"))[0].fix == "--axes opencv"


@pytest.mark.parametrize("axes", ["ros", "unity", "unreal", "opencv-inverse", "opengl-inverse"])
def test_a_convention_is_named_and_reading_by_it_restores_the_poses(
    tmp_path: Path, images: list[Path], axes: str
) -> None:
    name = axes.partition("-")[0]
    # Columns: x, y and z of the convention in terms of right, down and forward.
    own = {"opencv": "+x+y+z", "opengl": "+x-y-z", "ros": "+z-x-y", "unity": "+x-y+z", "unreal": "+z+x-y"}[name]
    columns = np.eye(4)
    columns[:3, :3] = np.stack(
        [(1 if s == "+" else -1) * np.eye(3)["xyz".index(a)] for s, a in zip(own[::2], own[1::2])], 1
    )
    written = POSES @ columns
    if name in ("unity", "unreal"):
        written = np.diag([1.0, -1.0, 1.0, 1.0]) @ written
    if axes.endswith("inverse"):
        written = np.linalg.inv(written)
    path = room.write_capture(tmp_path, images, written @ room.OPENGL)
    found = the_error(contradictions(check(path)))
    assert found.fix == f"--axes {axes}", found
    raw = with_axes(read_raw(path, Findings()), axes)  # type: ignore[arg-type]
    restored = np.stack([f.camera_to_world for f in raw.frames if f.camera_to_world is not None])
    np.testing.assert_allclose(restored, POSES, atol=1e-9)


def transposed(poses: np.ndarray) -> np.ndarray:
    result = poses.copy()
    result[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    return result


def requaternioned(poses: np.ndarray) -> np.ndarray:
    result = poses.copy()
    result[:, :3, :3] = Rotation.from_quat(
        np.roll(Rotation.from_matrix(poses[:, :3, :3]).as_quat(), -1, axis=1)
    ).as_matrix()
    return result


def on_a_circle(poses: np.ndarray) -> np.ndarray:
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    turns = np.linspace(0, 2 * np.pi, len(poses), endpoint=False)
    result[:, :3, :3] = Rotation.from_rotvec(-turns[:, None] * np.array([0.0, 1.0, 0.0])).as_matrix()
    result[:, 0, 3], result[:, 2, 3] = np.cos(turns), np.sin(turns)
    return result


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (transposed, "transposed"),
        (requaternioned, "quaternions"),
        (lambda p: p[np.random.default_rng(0).permutation(len(p))], "shuffled"),
        (lambda p: p[np.random.default_rng(0).permutation(len(p))] @ room.OPENGL, "shuffled"),
        (on_a_circle, "invented"),
        (lambda p: p[::-1], "reverse order"),
        (lambda p: np.roll(p, -3, axis=0), "3 frames earlier"),
        (lambda p: np.roll(p, 1, axis=0), "1 frame later"),
    ],
)
def test_wrong_poses_are_refused_with_the_cause(
    tmp_path: Path, images: list[Path], change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    finding = the_error(pose_findings(tmp_path, images, change(POSES)))
    assert words in finding.message + finding.consequence, finding


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ({"fl_x": 330.0, "fl_y": 330.0}, "the focal length is 1.5 times too long: 22"),
        ({"fl_x": 154.0, "fl_y": 154.0}, "times too short: 2"),
        ({"cx": 210.0}, "the principal point is wrong"),
        ({"k1": -0.4, "k2": 0.1}, "undistorted already"),
    ],
)
def test_a_wrong_lens_is_named_with_what_fits(
    tmp_path: Path, images: list[Path], lens: dict[str, float], words: str
) -> None:
    (finding,) = pose_findings(tmp_path, images, POSES, **lens)
    assert words in finding.message, finding


def test_images_turned_upside_down_are_named(tmp_path: Path, images: list[Path]) -> None:
    turned = []
    for path in images:
        image = cv2.imread(str(path))
        assert image is not None
        turned.append(tmp_path / path.name)
        cv2.imwrite(str(turned[-1]), np.ascontiguousarray(image[::-1, ::-1]))
    assert "turned by 180 degrees" in the_error(pose_findings(tmp_path, turned, POSES)).message


def test_swapped_images_are_warned_of_by_frame(tmp_path: Path, images: list[Path]) -> None:
    swapped = list(images)
    swapped[5], swapped[23] = swapped[23], swapped[5]
    path = room.write_capture(tmp_path, swapped, POSES)
    report = check(path)
    found = contradictions(report)
    assert report.raw is not None
    named = {name for finding in found for name in finding.frames}
    assert named == {report.raw.frames[5].name, report.raw.frames[23].name}
    assert all(finding.severity == "warning" and "--leave-out" in finding.consequence for finding in found)


def test_images_without_texture_lead_to_no_claim(tmp_path: Path) -> None:
    images = []
    for i in range(12):
        images.append(tmp_path / f"{i:02d}.png")
        cv2.imwrite(str(images[-1]), np.tile(np.linspace(40, 200, 320, dtype=np.uint8)[None, :, None], (240, 1, 3)))
    assert pose_findings(tmp_path / "capture", images, POSES[np.arange(12)[::-1]]) == ()


def test_the_arc_of_allowed_directions_has_its_ends() -> None:
    x, y, z = np.eye(3)
    between = (x + y) / np.sqrt(2)
    above = np.array([np.cos(0.1) / np.sqrt(2), np.cos(0.1) / np.sqrt(2), np.sin(0.1)])
    beyond = np.array([np.cos(0.3), -np.sin(0.3), 0.0])
    found = angles_to_arcs(np.stack([between, above, beyond, z, x]), np.stack([x] * 5), np.stack([y] * 4 + [x]))
    np.testing.assert_allclose(found, [0, 0.1, 0.3, np.pi / 2, 0], atol=1e-6)


@pytest.mark.parametrize(
    "lens",
    [
        Lens("PINHOLE", 640, 480, (500.0, 510.0, 320.0, 240.0)),
        Lens("OPENCV", 640, 480, (500.0, 510.0, 320.0, 240.0, -0.2, 0.05, 0.001, -0.002)),
        Lens("OPENCV_FISHEYE", 640, 480, (300.0, 300.0, 320.0, 240.0, 0.02, -0.01, 0.0, 0.0)),
    ],
)
def test_directions_of_pixels_undo_the_lens(lens: Lens) -> None:
    points = np.random.default_rng(0).uniform((-0.6, -0.5, 1), (0.6, 0.5, 1), (50, 3))
    rays = directions(lens, lens.distort(points[:, :2]))
    np.testing.assert_allclose(rays / rays[:, 2:], points, atol=1e-4)
    seen, _ = Camera(Intrinsics(640, 480, 500.0, 510.0, 320.0, 240.0), np.eye(4)).project(points)
    assert np.isfinite(seen).all()


def usable(report: Report, words: str, severity: str) -> None:
    assert any(words in f.message and f.severity == severity for f in report.findings), report.findings
    assert report.refused == (severity == "error")


def test_cameras_in_one_place_are_refused(tmp_path: Path, images: list[Path]) -> None:
    still = POSES.copy()
    still[:, :3, 3] = POSES[0, :3, 3]
    usable(with_poses(check(room.write_capture(tmp_path, images, still))), "all cameras are at one place", "error")


def test_black_images_are_refused_and_a_few_are_named(tmp_path: Path, images: list[Path]) -> None:
    black = tmp_path / "black.png"
    cv2.imwrite(str(black), np.random.default_rng(0).integers(0, 4, (240, 320, 3), np.uint8))
    blacks = []
    for i in range(12):
        blacks.append(tmp_path / f"black{i}.png")
        blacks[-1].write_bytes(black.read_bytes())
    usable(check(room.write_capture(tmp_path / "all", blacks, POSES[:12])), "12 of 12 images are blank", "error")
    report = check(room.write_capture(tmp_path / "some", [*blacks[:2], *images[2:]], POSES))
    usable(report, "the image is blank", "warning")
    assert report.raw is not None
    named = {name for f in report.findings for name in f.frames}
    assert named == {f.name for f in report.raw.frames[:2]}


@pytest.mark.parametrize("count", [1, 3])
def test_a_handful_of_frames_is_refused(tmp_path: Path, images: list[Path], count: int) -> None:
    report = check(room.write_capture(tmp_path, images[:count], POSES[:count]))
    usable(report, f"the capture has only {count} frame", "error")


def test_the_import_refuses_what_the_check_refuses_and_takes_the_option(tmp_path: Path, images: list[Path]) -> None:
    from nvsim.events import Event, Warning
    from nvsim.project.config import CaptureConfig
    from nvsim.project.project import Project
    from nvsim.project.stages import imported

    path = room.write_capture(tmp_path, images, POSES @ room.OPENGL)
    heard: list[Event] = []
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        with pytest.raises(InputError, match="OpenCV's axes.*--axes opencv corrects it"):
            imported.run(project, path, CaptureConfig(scale=1.0), heard.append)
        given = imported.run(project, path, CaptureConfig(scale=1.0, poses="given"), heard.append)
        assert any(isinstance(e, Warning) and "OpenCV's axes" in str(e) for e in heard) and len(given.frames) == 36
        config = CaptureConfig(scale=1.0, axes="opencv", poses="given")
        capture = imported.run(project, path, config, heard.append)
        assert imported.capture_config(project).axes == "opencv"
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], POSES, atol=1e-9)
