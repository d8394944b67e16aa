"""Floor heights on synthetic floors whose height is known everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.building import BuildingConfig
from nvsim.building.scene import make_scene
from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.perception.floor_height import estimate_floor, stair_floor


def walk_along_x(length: float, height: float, floor=lambda x: 0 * x) -> np.ndarray:
    x = np.arange(0, length, 0.3)
    return np.column_stack([x, 0.2 * np.sin(x), floor(x) + height])


def scan(rng, floor, low=(-3, -3), high=(15, 3), number=20000, noise=0.01) -> np.ndarray:
    xy = rng.uniform(low, high, (number, 2))
    return np.column_stack([xy, floor(xy[:, 0]) + rng.normal(0, noise, number)])


def cloud(*parts: np.ndarray, kind: str = "lidar") -> Cloud:
    return Cloud(np.concatenate(parts).astype(np.float32), None, kind)


def error_along(surface, walk, floor) -> float:
    return float(np.abs(surface.height_at(walk[:, :2]) - floor(walk[:, 0])).max())


@pytest.mark.parametrize("slope", [0.0, 0.03, 0.08])
def test_ramp_is_followed_to_a_centimeter(slope):
    def floor(x):
        return slope * np.clip(x - 4, 0, 5)

    rng = np.random.default_rng(0)
    walk = walk_along_x(12, 1.2, floor)
    surface = estimate_floor(cloud(scan(rng, floor)), walk)
    off = np.abs(surface.height_at(walk[:, :2]) - floor(walk[:, 0]))
    # The knees of the ramp are rounded by the 1 m grid; between them the floor is met.
    straight = (np.abs(walk[:, 0] - 4) > 1) & (np.abs(walk[:, 0] - 9) > 1)
    assert off[straight].max() < 0.012 and off.max() < 0.03


def test_tables_beside_the_walk_do_not_win_with_ten_times_the_points():
    rng = np.random.default_rng(1)
    floor = lambda x: 0 * x - 1.5  # noqa: E731
    walk = walk_along_x(12, 1.2, floor)
    table = scan(rng, lambda x: 0 * x - 0.78, (2, 0.5), (10, 2.5), 60000)
    surface = estimate_floor(cloud(scan(rng, floor, number=6000), table), walk)
    assert error_along(surface, walk, floor) < 0.01
    under = np.column_stack([np.linspace(3, 9, 20), np.full(20, 1.5)])
    assert np.abs(surface.height_at(under) + 1.5).max() < 0.03


def kitchen(rng, floor_points: int) -> np.ndarray:
    """Cabinets with tops 0.77 m below the cameras fill the view; the floor 1.45 m below them shows beside them only."""
    tops = np.column_stack([rng.uniform((-1.5, -1.2), (4.5, 1.2), (30000, 2)), rng.normal(0.68, 0.008, 30000)])
    fronts = np.column_stack([rng.uniform(-1.5, 4.5, 9000), np.full(9000, 1.2), rng.uniform(0, 0.68, 9000)])
    floor = np.column_stack(
        [rng.uniform((-1.5, 1.25), (4.5, 2.2), (floor_points, 2)), rng.normal(0, 0.01, floor_points)]
    )
    return np.concatenate([tops, fronts, floor])


def test_a_level_with_points_under_it_is_furniture() -> None:
    rng = np.random.default_rng(3)
    walk = walk_along_x(3, 1.45)
    surface = estimate_floor(cloud(kitchen(rng, 4000)), walk)
    assert np.abs(surface.height_at(walk[:, :2])).max() < 0.06


def test_stray_points_between_desks_and_the_floor_do_not_hide_the_floor() -> None:
    """Estimated depth scatters points between a desk and the floor: few points, but in as many patches as the floor."""
    rng = np.random.default_rng(5)
    walk = walk_along_x(3, 1.5)
    tops = np.column_stack([rng.uniform((-1.5, -1.2), (4.5, 1.2), (30000, 2)), rng.normal(0.74, 0.01, 30000)])
    stray = rng.uniform((-1.5, -1.2, 0.05), (4.5, 2.2, 0.7), (2500, 3))
    xy = rng.uniform((-1.5, 0.8), (4.5, 2.2), (3000, 2))
    drifting = np.column_stack([xy, 0.05 * np.sin(xy[:, 0]) + rng.normal(0, 0.01, 3000)])
    surface = estimate_floor(cloud(tops, stray, drifting, kind="images"), walk)
    assert np.abs(surface.height_at(walk[:, :2])).max() < 0.1


def test_fronts_of_cabinets_that_end_above_the_floor_do_not_hide_the_floor() -> None:
    """The images show the fronts down to 0.17 m, around a bed. The floor shows beside one side of the bed only."""
    rng = np.random.default_rng(6)
    turn = np.linspace(0, 2 * np.pi, 40)
    walk = np.column_stack([1.4 * np.cos(turn), 1.6 * np.sin(turn), np.full(40, 1.54)])
    along, side = rng.uniform(-2.2, 2.2, 12000), rng.integers(0, 3, 12000)
    x = np.where(side == 0, along, np.where(side == 1, -2.2, 2.2)) + rng.normal(0, 0.16, 12000)
    y = np.where(side == 0, 2.3, along) + rng.normal(0, 0.16, 12000)
    fronts = np.column_stack([x, y, rng.uniform(0.17, 0.85, 12000)])
    bed = np.column_stack([rng.uniform((-0.9, -1.1), (0.9, 1.1), (8000, 2)), rng.normal(0.5, 0.01, 8000)])
    floor = np.column_stack([rng.uniform((-1.4, -2.2), (1.4, -1.2), (2000, 2)), rng.normal(0, 0.004, 2000)])
    surface = estimate_floor(cloud(fronts, bed, floor, kind="images"), walk)
    assert np.abs(surface.height_at(floor[:, :2])).max() < 0.05


def test_fronts_of_beds_do_not_raise_the_floor_where_it_is_hidden() -> None:
    rng = np.random.default_rng(4)
    walk = walk_along_x(9, 1.4)
    floor = scan(rng, lambda x: 0 * x, (-1, -1), (3.5, 1), 6000)
    fronts = np.column_stack(
        [rng.uniform(4.5, 9, 9000), rng.choice([-0.6, 0.6], 9000), rng.uniform(0.04, 0.5, 9000)]
    ) + rng.normal(0, 0.01, (9000, 3))
    surface = estimate_floor(cloud(floor, fronts, kind="depth"), walk)
    assert error_along(surface, walk, lambda x: 0 * x) < 0.08


def test_furniture_that_hides_the_floor_is_refused_with_its_level_named() -> None:
    rng = np.random.default_rng(4)
    walk = walk_along_x(3, 1.45)
    with pytest.raises(InputError, match="Furniture may hide the floor.* 0.77 m below.*--camera-height"):
        estimate_floor(cloud(kitchen(rng, 0)), walk)
    surface = estimate_floor(cloud(kitchen(rng, 0)), walk, 1.45)
    assert np.abs(surface.height_at(walk[:, :2])).max() < 0.3  # no point shows it


def test_desks_near_the_cameras_are_refused_if_a_tenth_of_the_patches_are_under_them() -> None:
    rng = np.random.default_rng(7)
    walk = walk_along_x(3, 1.4)
    tops = np.column_stack([rng.uniform((-1.5, -1.2), (4.5, 1.2), (30000, 2)), rng.normal(0.74, 0.01, 30000)])
    things = rng.uniform((-1.5, -1.2, 0.8), (4.5, 1.2, 1.2), (3000, 3))
    fronts = np.column_stack([rng.uniform(-1.5, 4.5, 1500), np.full(1500, 1.2), rng.uniform(0.2, 0.7, 1500)])
    with pytest.raises(InputError, match="Furniture may hide the floor.* 1[0-4]% of the points"):
        estimate_floor(cloud(tops, things, fronts, kind="images"), walk)


def test_noise_above_and_below_the_floor_moves_it_by_less_than_two_centimeters():
    rng = np.random.default_rng(2)
    floor = lambda x: 0 * x  # noqa: E731
    walk = walk_along_x(12, 1.4, floor)
    clutter = rng.uniform([-3, -3, -0.6], [15, 3, 2.5], (15000, 3))
    surface = estimate_floor(cloud(scan(rng, floor, number=8000, noise=0.025), clutter), walk)
    assert error_along(surface, walk, floor) < 0.02


def test_sparse_sfm_cloud_with_a_known_camera_height():
    rng = np.random.default_rng(3)
    floor = lambda x: 0 * x + 0.4  # noqa: E731
    walk = walk_along_x(8, 1.5, floor)
    walls = rng.uniform([-2, 1.5, 0.4], [10, 1.6, 2.8], (3000, 3))
    surface = estimate_floor(cloud(scan(rng, floor, (-1, -1), (9, 1.5), 250, 0.03), walls, kind="sfm"), walk, 1.55)
    assert error_along(surface, walk, floor) < 0.03


def test_without_a_cloud_the_floor_lies_the_camera_height_below_the_walk():
    def floor(x):
        return 0.05 * x

    walk = walk_along_x(10, 1.1, floor)
    assert error_along(estimate_floor(None, walk, 1.1), walk, floor) < 0.035


def test_cloud_that_shows_no_floor_falls_back_to_the_camera_height():
    rng = np.random.default_rng(4)
    walk = walk_along_x(8, 1.2)
    ceiling = rng.uniform([0, -2, 2.4], [8, 2, 2.5], (2000, 3))
    assert error_along(estimate_floor(cloud(ceiling), walk, 1.2), walk, lambda x: 0 * x) < 1e-3


def test_neither_cloud_nor_camera_height_asks_for_it():
    with pytest.raises(InputError, match="camera height"):
        estimate_floor(None, walk_along_x(5, 1.2))


def test_heights_far_from_the_walk_stay_near_those_of_the_walk():
    rng = np.random.default_rng(5)
    floor = lambda x: 0 * x  # noqa: E731
    walk = walk_along_x(12, 1.2)
    surface = estimate_floor(cloud(scan(rng, floor)), walk)
    assert np.isfinite(surface.heights).all() and np.abs(surface.heights).max() < 0.1


def test_a_single_camera_is_enough():
    rng = np.random.default_rng(6)
    walk = np.array([[0.0, 0.0, 1.2]])
    surface = estimate_floor(cloud(scan(rng, lambda x: 0 * x, (-3, -3), (3, 3))), walk)
    assert abs(float(surface.height_at(np.zeros(2)))) < 0.01


def test_a_step_beside_the_walk_is_not_taken_for_floor():
    rng = np.random.default_rng(7)
    floor = lambda x: 0 * x  # noqa: E731
    walk = walk_along_x(12, 1.3)
    ground = scan(rng, floor, number=12000)
    on_step = (ground[:, 0] > 4) & (ground[:, 0] < 6) & (ground[:, 1] > 1.2) & (ground[:, 1] < 2.6)
    step = scan(rng, lambda x: 0 * x + 0.16, (4, 1.2), (6, 2.6), 3000)
    surface = estimate_floor(cloud(ground[~on_step], step), walk)
    under = np.stack(np.meshgrid(np.linspace(4.2, 5.8, 8), np.linspace(1.3, 2.5, 8)), -1)
    assert np.abs(surface.height_at(under)).max() < 0.04


@pytest.mark.parametrize("slab", [0.2, 0.3, 0.45])
@pytest.mark.parametrize("more", [1, 5])
def test_the_ceiling_of_the_storey_below_is_not_the_floor(slab, more):
    rng = np.random.default_rng(5)
    walk = walk_along_x(12, 1.3, lambda x: 0 * x + 3.0)
    floor = scan(rng, lambda x: 0 * x + 3.0, number=10000)
    ceiling = scan(rng, lambda x: 0 * x + 3.0 - slab, number=more * 10000)
    everything = cloud(floor, ceiling, scan(rng, lambda x: 0 * x, number=10000))
    surface = estimate_floor(everything, walk, above_another=True)
    assert error_along(surface, walk, lambda x: 0 * x + 3.0) < 0.02
    assert error_along(estimate_floor(everything, walk), walk, lambda x: 0 * x + 3.0) > 0.15, "which it else would be"
    alone = cloud(floor)
    once, again = (estimate_floor(alone, walk, above_another=a).heights for a in (False, True))
    assert np.abs(once - again).max() < 0.01, "where nobody was below, it changes nothing"


def test_a_stair_is_followed_with_its_landings():
    scene = make_scene(BuildingConfig(seed=1, size="small", storeys=2))
    flight = scene.plan.flight
    near = scene.walk[
        (np.abs(flight.distance_along(scene.walk[:, :2]) - 2.4) < 4) & (np.abs(scene.walk[:, 3] - 1.5) <= 1.5)
    ]
    surface = stair_floor(np.column_stack([near[:, :2], near[:, 3] + 1.3]), 1.3)
    along = np.arange(-0.5, 5.5, 0.05)[:, None]
    middle = flight.foot + along * flight.direction
    off = surface.height_at(middle) - flight.height_at(middle)
    assert np.abs(off).max() < 0.06 and np.sqrt((off**2).mean()) < 0.02
    for rect, height in flight.treads():
        assert abs(float(surface.height_at(np.array(rect.center))) - height) < 0.07, "a tread is within half a rise"
