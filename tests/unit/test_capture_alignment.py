"""Up, scale and the way back, against rooms whose truth is known."""

from __future__ import annotations

import json
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nvsim.capture.alignment import find_up, to_aligned_frame, to_capture_frame
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import find_floor
from nvsim.capture.formats import read_raw
from nvsim.capture.read import read
from nvsim.capture.triangulation import image_points
from nvsim.capture.types import Alignment
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.training.synthetic import EYE_HEIGHT, photograph
from nvsim.training.views import TrainingView


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


@pytest.mark.parametrize("seed", range(4))
def test_a_turned_capture_is_turned_back_to_z_up_by_the_smallest_rotation(tmp_path: Path, seed: int) -> None:
    rotation = Rotation.random(random_state=seed).as_matrix()
    poses, points = sample.turn(rotation, sample.walk(), sample.room())
    capture = read(sample.write_nerfstudio(tmp_path, poses, points))
    alignment = capture.alignment
    assert angle(alignment.rotation @ rotation @ [0, 0, 1], np.array([0, 0, 1.0])) < 0.1
    turned = np.degrees(Rotation.from_matrix(alignment.rotation).magnitude())
    assert turned == pytest.approx(angle(rotation[:, 2], np.array([0, 0, 1.0])), abs=0.1), "no turn about z"
    np.testing.assert_allclose(capture.positions[:, 2], 1.4, atol=0.02)
    back = to_capture_frame(capture.positions, alignment)
    np.testing.assert_allclose(back, poses[:, :3, 3], atol=1e-12)


@pytest.mark.parametrize(("tilt", "untouched"), [(0.0, True), (1.7, True), (2.3, False), (10.0, False)])
def test_only_a_tilt_above_two_degrees_is_corrected(tmp_path: Path, tilt: float, untouched: bool) -> None:
    rotation = Rotation.from_euler("x", tilt, degrees=True).as_matrix()
    poses, points = sample.turn(rotation, sample.walk(24), sample.room(20000))
    capture = read(sample.write_nerfstudio(tmp_path, poses, points))
    assert capture.alignment.is_identity is untouched
    if untouched:
        flip = np.diag([1.0, -1, -1, 1])
        assert np.array_equal([f.camera_to_world for f in capture.frames], poses @ flip @ flip)
        assert capture.cloud is not None and np.array_equal(capture.cloud.points, points)


def test_up_does_not_lean_when_every_camera_looks_down() -> None:
    up, unsure = find_up(sample.walk(pitch_degrees=35))
    assert angle(up, np.array([0, 0, 1.0])) < 0.1 and unsure < 5


def test_a_few_cameras_mounted_on_their_side_do_not_count() -> None:
    poses = sample.walk(20, pitch_degrees=0)
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    poses[::5, :3, :3] = poses[::5, :3, :3] @ quarter
    assert angle(find_up(poses)[0], np.array([0, 0, 1.0])) < 1


@pytest.mark.parametrize("leaning", [2.5, -2.5])
def test_vertical_edges_correct_the_floor_of_a_sparse_cloud(
    leaning: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("WIDTH", 640), ("HEIGHT", 480), ("FOCAL", 400.0)):
        monkeypatch.setattr(sample, name, value)
    world = Rotation.from_euler("xz", [40, 20], degrees=True).as_matrix()
    walk = sample.walk(40)
    rolled = Rotation.from_euler("z", np.random.default_rng(4).normal(0, 3, (40, 1)), degrees=True).as_matrix()
    walk[:, :3, :3] = walk[:, :3, :3] @ rolled  # a person does not hold the camera level
    points = sample.room() @ Rotation.from_euler("x", leaning, degrees=True).as_matrix().T
    poses, points = sample.turn(world, walk, points)
    read_from = sample.write_colmap(tmp_path, poses, points, binary=False)
    off = []
    for shown in (0, 16):
        for number, pose in enumerate(walk):
            cv2.imwrite(str(tmp_path / "images" / f"{number:03d}.png"), _door_frames(pose, shown))
        up = (read(read_from).alignment.rotation @ world)[:, 2]
        off.append(angle(up, np.array([0, 0, 1.0])))
    assert off[0] > 1.5 and off[1] < 0.2


def _door_frames(pose: np.ndarray, count: int) -> np.ndarray:
    """The image of a room with the sides of `count` of 16 door frames, from a camera at `pose` (4, 4)."""
    camera = Camera(Intrinsics(640, 480, 400.0, 400.0, 320.0, 240.0), pose)
    image = np.full((480, 640, 3), 220, np.uint8)
    for turn in np.arange(count) * np.pi / 8:
        x, y = np.clip([4 * np.cos(turn), 4 * np.sin(turn)], -3, 3)
        places, depth = camera.project(np.array([[x, y, z] for z in np.linspace(0, 2.1, 200)]))
        ends = np.rint(places[depth > 0.1] * 16 - 8).astype(int)
        if len(ends):
            cv2.polylines(image, [ends.reshape(-1, 1, 2)], False, (30, 30, 30), 2, cv2.LINE_AA, 4)
    return image


def test_cameras_that_all_look_one_way_still_give_an_up_but_an_unsure_one() -> None:
    poses = sample.walk(12)
    poses[:, :3, :3] = poses[0, :3, :3]
    up, unsure = find_up(poses)
    assert angle(up, poses[0, :3, 1] * -1) < 0.1 and unsure >= 15


def test_the_floor_corrects_cameras_that_lean() -> None:
    poses = sample.walk(12)
    poses[:, :3, :3] = poses[0, :3, :3]  # pitched down 10 degrees, all the same way
    up, unsure = find_up(poses)
    assert angle(up, np.array([0, 0, 1.0])) == pytest.approx(10, abs=0.1)
    floor = find_floor(sample.room(), poses[:, :3, 3], up, unsure)
    assert floor is not None and angle(floor.normal, np.array([0, 0, 1.0])) < 0.1
    assert floor.offset == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("unit", [0.01, 1.0, 300.0])
def test_the_floor_is_found_below_a_brighter_desk_in_any_unit(unit: float) -> None:
    rng = np.random.default_rng(3)
    desk = np.stack([rng.uniform(0, 2, 3000), rng.uniform(0, 2, 3000), rng.normal(0.75, 0.004, 3000)], axis=1)
    points = np.concatenate([sample.room(), desk])
    floor = find_floor(points * unit, sample.walk()[:, :3, 3] * unit, np.array([0, 0, 1.0]))
    assert floor is not None
    assert floor.height_of(np.array([[0, 0, 1.4 * unit]]))[0] == pytest.approx(1.4 * unit, rel=0.01)


def test_walls_alone_have_no_floor() -> None:
    points = sample.room(20000)
    walls = points[np.abs(points[:, :2]).max(axis=1) > 2.95]
    walls = walls[walls[:, 2] > 0.05]
    assert find_floor(walls, sample.walk()[:, :3, 3], np.array([0, 0, 1.0])) is None


@pytest.mark.parametrize("unit", [0.05, 7.0])
def test_a_camera_height_gives_the_scale_of_a_colmap_model(tmp_path: Path, unit: float) -> None:
    poses, points = sample.walk(), sample.room()
    poses[:, :3, 3] *= unit
    folder = sample.write_colmap(tmp_path, poses, points * unit, binary=True)
    assert not read(folder).alignment.scale_known
    capture = read(folder, camera_height=1.4)
    assert capture.alignment.scale_known and capture.alignment.scale == pytest.approx(1 / unit, rel=0.01)
    np.testing.assert_allclose(capture.positions, sample.walk()[:, :3, 3], rtol=0.02, atol=1e-6)
    assert read(folder, scale=3.0).alignment.scale == 3.0


def test_a_metric_claim_is_not_believed_when_the_cameras_would_be_giants(tmp_path: Path) -> None:
    poses, points = sample.walk(), sample.room()
    poses[:, :3, 3] *= 50
    path = sample.write_nerfstudio(tmp_path, poses, points * 50)
    assert not read(path).alignment.scale_known
    assert read(path, camera_height=1.4).alignment.scale == pytest.approx(0.02, rel=0.01)


def test_metric_captures_keep_their_meters_whatever_the_camera_height(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    assert read(path, camera_height=1.8).alignment.scale == 1.0


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_not_a_positive_number_is_refused(tmp_path: Path, value: float) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    with pytest.raises(InputError, match="positive"):
        read(path, scale=value)
    with pytest.raises(InputError, match="positive"):
        read(path, camera_height=value)


def test_a_camera_height_without_a_floor_asks_for_the_scale(tmp_path: Path) -> None:
    folder = sample.write_colmap(tmp_path, sample.walk(), sample.room(10), binary=False)
    with pytest.raises(InputError, match="--scale"):
        read(folder, camera_height=1.4)


def test_the_two_frames_are_inverse_to_each_other() -> None:
    alignment = Alignment(Rotation.random(random_state=5).as_matrix(), scale=2.5)
    points = np.random.default_rng(0).normal(size=(4, 5, 3))
    np.testing.assert_allclose(to_capture_frame(to_aligned_frame(points, alignment), alignment), points, atol=1e-12)
    np.testing.assert_allclose(to_aligned_frame(points[0, 0], alignment), 2.5 * alignment.rotation @ points[0, 0])


LENS = Intrinsics.from_fov(480, 360, np.radians(80))


@pytest.fixture(scope="module")
def photographs() -> list[TrainingView]:
    """A room, photographed by a person who walks along it."""
    views = []
    for i in range(40):
        place = np.array([1.2 + 0.09 * i, 1.5 + 0.8 * (i % 2), EYE_HEIGHT])
        camera = Camera(LENS.scaled(960, 720), camera_pose(place, 0.8 * (i % 4), -0.45))
        views.append(photograph(f"{i:04d}", camera).at_half_size())
    return views


def write_images_alone(folder: Path, views: list[TrainingView], rotation: np.ndarray, unit: float) -> Path:
    """A capture of photographs and their poses in `unit` per meter, turned, with nothing that claims meters."""
    frames = []
    for view in views:
        cv2.imwrite(str(folder / f"{view.name}.png"), view.image[..., ::-1])
        pose = np.eye(4)
        pose[:3, :3] = rotation @ view.camera.rotation @ np.diag([1.0, -1, -1])  # OpenGL's axes
        pose[:3, 3] = unit * rotation @ view.camera.position
        frames.append({"file_path": f"{view.name}.png", "transform_matrix": pose.tolist()})
    lens = {"fl_x": LENS.fx, "fl_y": LENS.fy, "cx": LENS.cx, "cy": LENS.cy, "w": LENS.width, "h": LENS.height}
    path = folder / "transforms.json"
    path.write_text(json.dumps({**lens, "camera_model": "OPENCV", "applied_scale": 0.5, "frames": frames}))
    return path


@pytest.mark.parametrize("unit", [0.2, 30.0])
def test_images_alone_show_the_floor_that_a_camera_height_is_measured_from(
    photographs: list[TrainingView], tmp_path: Path, unit: float
) -> None:
    rotation = Rotation.from_euler("xy", [20, -9], degrees=True).as_matrix()
    path = write_images_alone(tmp_path, photographs, rotation, unit)
    assert not read(path).alignment.scale_known
    alignment = read(path, camera_height=EYE_HEIGHT).alignment
    assert alignment.scale_known and alignment.scale == pytest.approx(1 / unit, rel=0.05)
    assert angle(alignment.rotation @ rotation @ [0, 0, 1], np.array([0, 0, 1.0])) < 1


def test_a_capture_whose_images_cannot_be_read_shows_no_points(photographs: list[TrainingView], tmp_path: Path) -> None:
    raw = read_raw(write_images_alone(tmp_path, photographs, np.eye(3), 1.0), Findings())
    assert len(image_points(raw.frames)) > 100 and not len(image_points(raw.frames[:1])) and not len(image_points([]))
    for image in tmp_path.glob("*.png"):
        image.write_bytes(b"nothing")
    assert not len(image_points(raw.frames))
