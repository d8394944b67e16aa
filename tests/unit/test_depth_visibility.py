"""What the rest of a capture says against a depth map, in a room of which everything is known: a wall at 4 m and a post
before it, seen by cameras in a row."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.depth.config import DepthConfig
from nvsim.depth.visibility import DepthCheck, _lens_and_pose, _shares_in_view
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose

LENS = Intrinsics(80, 60, 60.0, 60.0, 40.0, 30.0)
WALL, POST, HALF = 4.0, 2.0, 0.1
CAMERAS = []
for at in np.linspace(-1, 1, 9):
    pose = np.eye(4)
    pose[0, 3] = at
    CAMERAS.append(Camera(LENS, pose))
HERE = 4


def true_map(camera: Camera) -> np.ndarray:
    rays = camera.rays()
    at_post = camera.position[0] + POST * rays[..., 0] / rays[..., 2]
    return np.where(np.abs(at_post) < HALF, 1 / POST, 1 / WALL).astype(np.float32)


def points() -> np.ndarray:
    x, y = np.meshgrid(np.arange(-4, 4, 0.03), np.arange(-2, 2, 0.03))
    wall = np.stack([x, y, np.full_like(x, WALL)], axis=-1).reshape(-1, 3)
    post = wall[np.abs(wall[:, 0]) < HALF] * [1, 0.5, 0] + [0, 0, POST]
    return np.concatenate([wall, post]).astype(np.float32)


class WithoutCheckingMaps(DepthConfig):
    checking_maps = 0


def said_against(
    changed: np.ndarray, cloud: np.ndarray | None = None, config: type[DepthConfig] = DepthConfig
) -> np.ndarray:
    maps = [true_map(camera) for camera in CAMERAS]
    maps[HERE] = changed
    settings = config(voxel=0.035, farthest=10.0)
    rest = DepthCheck(points() if cloud is None else cloud, CAMERAS, maps.__getitem__, settings)
    return rest.contradicted_pixels(HERE)


def test_nothing_is_said_against_what_is_true_but_beside_borders() -> None:
    true = true_map(CAMERAS[HERE])
    spoken = said_against(true)
    border = np.abs(np.diff(true, axis=1, append=true[:, -1:])) > 0.01
    border |= np.roll(border, 1, axis=1)
    assert not spoken[:, ~border.any(axis=0)].any()


def test_a_map_that_looks_through_a_wall_is_contradicted_by_what_stands_there() -> None:
    wrong = true_map(CAMERAS[HERE])
    wrong[10:30, 5:25] = 1 / 5.5
    spoken = said_against(wrong, config=WithoutCheckingMaps)
    assert spoken[10:30, 5:25].all()
    assert not spoken[35:, 5:25].any()


def test_a_depth_in_the_air_is_contradicted_by_who_sees_through_it_though_no_cloud_shows_more() -> None:
    wrong = true_map(CAMERAS[HERE])
    wrong[10:30, 5:25] = 1 / 3.0
    nothing = np.empty((0, 3), np.float32)
    assert said_against(wrong, nothing)[10:30, 5:25].all()
    assert not said_against(wrong, nothing, WithoutCheckingMaps).any()


@pytest.mark.parametrize("off", [0.97, 1.03])
def test_a_depth_that_is_off_by_less_than_it_may_be_stays(off: float) -> None:
    near = true_map(CAMERAS[HERE]) * np.float32(off)
    assert not said_against(near)[:, :30].any()


def test_unknown_pixels_and_unseen_frames_are_not_spoken_of() -> None:
    assert not said_against(np.zeros((60, 80), np.float32)).any()
    alone = DepthCheck(np.empty((0, 3), np.float32), CAMERAS[:1], lambda i: true_map(CAMERAS[0]), DepthConfig())
    assert not alone.contradicted_pixels(0).any()


def test_the_shares_in_view_are_those_of_the_projected_points() -> None:
    rng = np.random.default_rng(0)
    some = rng.uniform(-4, 4, (200, 3)).astype(np.float32)
    cameras = [Camera(LENS, camera_pose(*rng.uniform(-2, 2, (1, 3)), rng.uniform(0, 6), 0.3)) for _ in range(20)]
    expected = []
    for camera in cameras:
        pixels, depth = camera.project(some)
        expected.append(((depth > 0) & (pixels > 0).all(axis=1) & (pixels < (80, 60)).all(axis=1)).mean())
    lenses, poses = zip(*map(_lens_and_pose, cameras), strict=True)
    shares = _shares_in_view(some, np.array(lenses), np.array(poses), np.full((20, 2), (80, 60)))
    np.testing.assert_allclose(shares, expected)
    assert min(expected) < 0.05 and max(expected) > 0.1
