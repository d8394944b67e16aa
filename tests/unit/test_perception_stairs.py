"""On a stair the floor is the slope through its treads: rays meet it that do not point down, and treads are not
obstacles."""

from __future__ import annotations

import numpy as np
import pytest
from stairwell import SLOPE, stairwell

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.obstacles import ObstacleConfig, split_obstacles
from nvsim.perception.stairs import Stairs

RISE, GOING = 0.168, 0.28


def below() -> FloorSurface:
    return stairwell().storeys[0]


def test_a_stair_is_where_the_surface_is_as_steep_as_steps_are_and_nowhere_else() -> None:
    stairs = Stairs.of(below())
    x, y = np.meshgrid(np.arange(2.3, 6.8, 0.1), np.arange(0.1, 1.0, 0.1))
    assert stairs.is_on_stairs(np.stack([x, y], axis=-1)).all()
    x, y = np.meshgrid(np.arange(2.7, 11.0, 0.1), np.arange(1.3, 7.0, 0.1))
    assert not stairs.is_on_stairs(np.stack([x, y], axis=-1)).any(), "the room beside the stair, behind a drop"
    assert (
        stairs.is_on_stairs(np.array([1.8, 0.5])) and not stairs.is_on_stairs(np.array([[1.5, 0.5], [1.0, 0.5]])).any()
    ), "a step before"
    assert not stairs.is_on_stairs(np.array([[50.0, 0.5], [np.nan, 0.5]])).any(), "outside the surface"


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.3, 3.0])
def test_ramps_and_cliffs_are_no_stairs(slope: float) -> None:
    heights = np.tile(slope * 0.1 * np.arange(40, dtype=np.float32), (30, 1))
    assert not Stairs.of(FloorSurface(heights, (0.0, 0.0), 0.1))


def test_without_stairs_rays_meet_the_floor_as_they_do() -> None:
    rng = np.random.default_rng(0)
    surface = FloorSurface((0.05 * rng.standard_normal((20, 20))).astype(np.float32), (0.0, 0.0), 1.0)
    rays = rng.standard_normal((500, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    eye = np.array([9.0, 9.0, 1.5])
    np.testing.assert_array_equal(
        Stairs.of(surface).distance_along_rays(eye, rays), surface.distance_along_rays(eye, rays)
    )


def test_rays_meet_the_slope_where_the_plane_through_it_is_also_upwards() -> None:
    # The slope is the plane z = 0.6 (x - 2) between x = 2 and 7, y = 0 and 1; the cameras climb it.
    rng = np.random.default_rng(1)
    stairs, upwards = Stairs.of(below()), 0
    for x in (1.0, 3.0, 5.0):
        eye = np.array([x, 0.5, max(0.0, SLOPE * (x - 2)) + 1.4])
        rays = np.column_stack([np.ones(400), rng.uniform(-0.3, 0.3, 400), rng.uniform(-1.5, 0.5, 400)])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        along = (eye[2] - SLOPE * (eye[0] - 2)) / (SLOPE * rays[:, 0] - rays[:, 2])
        ends = eye + along[:, None] * rays
        on = (along > 0) & (ends[:, 0] > 2.15) & (ends[:, 0] < 6.85) & (ends[:, 1] > 0.05) & (ends[:, 1] < 0.95)
        on &= eye[2] + (2 - eye[0]) / rays[:, 0] * rays[:, 2] > 0 if x < 2 else True  # not into the ground before it
        np.testing.assert_allclose(stairs.distance_along_rays(eye, rays)[on], along[on], atol=0.01)
        upwards += int((on & (rays[:, 2] > -0.02)).sum())
    assert upwards > 30, "rays that do not point down are among them"


def test_the_side_of_a_stair_is_no_floor_and_the_floor_before_it_and_behind_it_is() -> None:
    stairs = Stairs.of(below())
    eye = np.array([5.0, 4.0, 1.5])
    toward = np.array([[5.0, 3.0, 0.0], [5.0, 0.5, 1.0], [5.0, -1.0, 0.0]]) - eye
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    distance = stairs.distance_along_rays(eye, toward)
    assert distance[0] == pytest.approx(np.linalg.norm([0, 1.0, 1.5]), abs=1e-3)
    assert np.isinf(distance[1]) and np.isinf(distance[2])
    over = np.array([[4.0, -3.0, 0.0]]) - [4.0, 0.5, 9.0]  # from above, over the stair, onto the floor behind it
    length = float(np.linalg.norm(over))
    assert stairs.distance_along_rays(np.array([4.0, 0.5, 9.0]), over / length)[0] == pytest.approx(length, abs=1e-3)


def steps() -> Cloud:
    """The treads and risers of the stair, and a post of 0.4 m on its middle; dense."""
    t, y = np.meshgrid(np.linspace(0, 1, 8, endpoint=False), np.arange(0.01, 1.0, 0.03))
    parts = []
    for k in range(17):
        first, height = 2.0 + GOING * (k + 0.5), RISE * (k + 1)
        parts.append(np.stack([first + GOING * t, y, np.full_like(t, height)], axis=-1).reshape(-1, 3))
        parts.append(np.stack([np.full_like(t, first), y, height - RISE * t], axis=-1).reshape(-1, 3))
    z = np.arange(0.2, 0.6, 0.02)
    post = np.stack([np.full_like(z, 4.5), np.full_like(z, 0.5), SLOPE * 2.5 + z], axis=-1)
    return Cloud(np.concatenate([*parts, post]).astype(np.float32))


def test_treads_and_risers_do_not_stand_on_the_stair_and_a_post_does() -> None:
    found = split_obstacles(steps(), below(), ObstacleConfig())
    on = (found.points[:, 0] > 2.5) & (found.points[:, 0] < 6.5)
    assert len(found.points[on])
    assert np.abs(found.points[on][:, 0] - 4.5).max() < 0.1
    assert found.confirmed is not None
    x = np.arange(2.5, 6.5, 0.1)
    assert found.confirmed.is_supported(np.column_stack([x, np.full_like(x, 0.3)])).all()


@pytest.mark.parametrize("up", [True, False])
def test_steps_are_floor_to_a_camera_that_climbs_and_to_one_that_descends(up: bool) -> None:
    forward = np.array([1.0, 0.0, 0.0]) if up else np.array([-1.0, 0.0, -1.0]) / np.sqrt(2)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = [3.0, 0.3, SLOPE + 1.4] if up else [6.0, 0.3, 4 * SLOPE + 1.4]
    camera = Camera(Intrinsics(160, 120, 100.0, 100.0, 80.0, 60.0), pose)
    seen = GeometricFloor(steps(), below()).project(camera)
    stair = Stairs.of(below()).is_on_stairs(seen.ground) & (seen.distance > 0)
    stair &= np.abs(seen.ground[..., 1] - 0.5) < 0.45
    assert stair.mean() > 0.1
    assert seen.floor[stair].mean() > 0.9
