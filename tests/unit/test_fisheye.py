"""The frames of a fisheye lens are recognized and stored as the pinhole images that the camera would have taken."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from textured_room import HEIGHT, WIDTH, seen, walk, write_images
from textured_video import write_video

from nvsim.footage.extraction import extract_frames
from nvsim.footage.fisheye import Fisheye, Matched, find_fisheye, rays_of
from nvsim.footage.sources import need_footage
from nvsim.reconstruction.image_sets import store_images

LENS = Fisheye(WIDTH, HEIGHT, WIDTH / np.radians(130))


def fisheye_image(pose: NDArray[np.float64], lens: Fisheye = LENS) -> NDArray[np.uint8]:
    u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = rays_of(np.column_stack([u.ravel(), v.ravel()]), lens.width, lens.height, lens.focal)
    return seen(pose, rays.reshape(lens.height, lens.width, 3))


def pinhole_image(pose: NDArray[np.float64], lens: Fisheye = LENS) -> NDArray[np.uint8]:
    k = lens.pinhole
    u, v = np.meshgrid((np.arange(k.width) + 0.5 - k.cx) / k.fx, (np.arange(k.height) + 0.5 - k.cy) / k.fy)
    return seen(pose, np.stack([u, v, np.ones_like(u)], axis=-1))


def difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Mean difference away from the border, gray levels."""
    inner = np.s_[8:-8, 8:-8]
    return float(np.abs(one[inner].astype(float) - other[inner]).mean())


def gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def matched_points(degrees: float | None, focal: float = 0.0, count: int = 12) -> list[Matched]:
    """Points of a room as two images of a lens see them, 0.3 pixels off; a fifth of the matches is wrong."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(count):
        points = rng.uniform(-4, 4, (800, 3)) * (1, 0.7, 1)
        turn, move = Rotation.from_rotvec(rng.normal(0, 0.1, 3)).as_matrix(), rng.normal(0, 0.2, 3)
        pair = [
            projected(points, degrees, focal),
            projected(points @ turn.T + move, degrees, focal),
        ]
        inside = np.logical_and(*[((p > 0) & (p < (640, 480))).all(axis=1) for p in pair])
        one, other = (p[inside][:200] + rng.normal(0, 0.3, (min(200, inside.sum()), 2)) for p in pair)
        wrong = rng.random(len(one)) < 0.2
        other[wrong] = rng.uniform(0, 480, (int(wrong.sum()), 2))
        found.append((one, other))
    return found


def projected(points: NDArray[np.float64], degrees: float | None, focal: float) -> NDArray[np.float64]:
    """Pixels (N, 2) of a fisheye lens of `degrees` along 640 pixels, or of a pinhole camera; NaN behind it."""
    flat = np.linalg.norm(points[:, :2], axis=1)
    angle = np.arctan2(flat, points[:, 2])
    radius = focal * np.tan(angle) if degrees is None else angle * 640 / np.radians(degrees)
    radius[(points[:, 2] < 0.2) & (degrees is None or degrees < 170)] = np.nan
    return np.asarray(points[:, :2] / flat[:, None] * radius[:, None] + (320, 240))


@pytest.mark.parametrize("degrees", [100.0, 120.0, 147.0, 175.0])
def test_the_angle_of_a_fisheye_lens_is_found(degrees: float) -> None:
    lens = find_fisheye(matched_points(degrees), 640, 480)
    assert lens is not None
    assert lens.degrees == pytest.approx(degrees, abs=2.5)


@pytest.mark.parametrize("focal", [260.0, 340.0, 500.0, 900.0])
def test_a_perspective_lens_is_none(focal: float) -> None:
    assert find_fisheye(matched_points(None, focal), 640, 480) is None


def test_a_few_matches_show_no_lens() -> None:
    assert find_fisheye(matched_points(120.0, count=3), 640, 480) is None
    assert find_fisheye([], 640, 480) is None


def test_a_rectified_image_is_that_of_the_pinhole_camera_and_its_points_are_in_place() -> None:
    pose = walk()[3]
    assert LENS.pinhole.fx == pytest.approx(WIDTH / 2 / np.tan(np.radians(50)))
    assert difference(LENS.rectified(fisheye_image(pose)), pinhole_image(pose)) < 4
    ray = np.array([0.5, -0.3, 1.0])
    flat = np.hypot(*ray[:2])
    pixel = ray[:2] / flat * np.arctan(flat) * LENS.focal + (WIDTH / 2, HEIGHT / 2)
    places = LENS.places(np.array([pixel, [1.0, 1.0]]))
    assert places[0] == pytest.approx(ray[:2] * LENS.pinhole.fx + (WIDTH / 2, HEIGHT / 2))
    assert np.isnan(places[1]).all()  # a corner of the fisheye image is outside the pinhole image


def test_the_frames_of_a_fisheye_video_are_pinhole_images_with_points(tmp_path: Path) -> None:
    poses = walk(150)[:50]
    path = write_video(tmp_path / "walk.avi", [gray(fisheye_image(pose)) for pose in poses])
    frames = extract_frames(need_footage(path), tmp_path / "frames")
    assert frames.fisheye is not None
    assert frames.fisheye.degrees == pytest.approx(130, abs=4)
    for name in (frames.names[0], frames.names[-1]):
        image = gray(np.asarray(cv2.imread(str(tmp_path / "frames" / name)), np.uint8))
        number = int(Path(name).stem.split("_")[1])
        assert difference(image, gray(pinhole_image(poses[number], frames.fisheye))) < 10
    assert (frames.places > 0).all() and (frames.places < (WIDTH, HEIGHT)).all()
    again = extract_frames(need_footage(path), tmp_path / "frames")
    assert again.fisheye == frames.fisheye
    np.testing.assert_array_equal(again.places, frames.places)


def test_fisheye_photographs_are_stored_as_pinhole_images_with_a_focal_length(tmp_path: Path) -> None:
    poses = walk(60)[:14]
    folder = tmp_path / "photos"
    folder.mkdir()
    lens = Fisheye(640, 480, 640 / np.radians(130))
    for i, pose in enumerate(poses):
        assert cv2.imwrite(str(folder / f"{i:03d}.png"), fisheye_image(pose, lens))
    events: list[object] = []
    stored = store_images(need_footage(folder), tmp_path / "images", lambda step, done, total: None, events.append)
    assert stored.fisheye == pytest.approx((130.0,), abs=4)
    assert any("fisheye lens of 1" in str(event) for event in events)
    assert stored.images.cameras[0].focal == pytest.approx(lens.pinhole.fx)
    image = cv2.imread(str(tmp_path / "images" / "005.png"))
    assert difference(np.asarray(image, np.uint8), pinhole_image(poses[5], lens)) < 10


def test_photographs_of_a_perspective_lens_stay_as_they_are(tmp_path: Path) -> None:
    paths = write_images(tmp_path / "photos", walk(60)[:14])
    stored = store_images(
        need_footage(tmp_path / "photos"), tmp_path / "images", lambda step, done, total: None, lambda event: None
    )
    assert stored.fisheye == ()
    assert (tmp_path / "images" / paths[5].name).read_bytes() == paths[5].read_bytes()
