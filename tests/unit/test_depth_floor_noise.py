"""Noise of the floor in a cloud from depth maps is removed, and objects on the floor remain."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.depth import floor_noise
from nvsim.depth.floor_noise import flatten_floor, floor_reach
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.obstacles import ObstacleConfig, split_obstacles

UP = np.array([0.0, 0.0, 1.0], np.float32)


def floor_cloud(
    sigma: float, height: float = 0.0, count: int = 4000
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 4, (count, 2)), height + rng.normal(0, sigma, count)])
    return points.astype(np.float32), np.tile(UP, (count, 1))


@pytest.mark.parametrize(("sigma", "reach"), [(0.005, 0.05), (0.03, 0.075), (0.04, 0.1), (0.12, 0.15)])
def test_the_reach_is_two_and_a_half_deviations_within_its_bounds(sigma: float, reach: float) -> None:
    points, normals = floor_cloud(sigma)
    assert floor_reach(points[:, 2], normals) == pytest.approx(reach, rel=0.08)


def test_walls_and_a_third_of_furniture_do_not_widen_the_reach() -> None:
    points, normals = floor_cloud(0.03)
    rng = np.random.default_rng(1)
    walls, tables = rng.uniform(-0.2, 0.2, 4000), np.full(1300, 0.4)
    heights = np.concatenate([points[:, 2], walls, tables])
    aside = np.tile(np.array([1.0, 0, 0], np.float32), (4000, 1))
    assert floor_reach(heights, np.concatenate([normals, aside, np.tile(UP, (1300, 1))])) == pytest.approx(
        0.075, rel=0.1
    )


def test_a_noisy_floor_becomes_flat_and_a_box_on_it_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normals = floor_cloud(0.04, height=1.0)
    box = np.column_stack([np.full((200, 2), 2.0), np.linspace(1.2, 1.9, 200)]).astype(np.float32)
    cloud = Cloud(np.concatenate([points, box]), None, "images", np.concatenate([normals, np.tile(-UP, (200, 1))]))
    found = flatten_floor(cloud, FloorSurface.flat(1.0))
    assert np.array_equal(found.points[-200:], box) and np.array_equal(found.points[:, :2], cloud.points[:, :2])
    monkeypatch.setattr(floor_noise, "_BLOCK", 300)
    assert np.array_equal(flatten_floor(cloud, FloorSurface.flat(1.0)).points, found.points), "in blocks of points"
    off = np.abs(found.points[:4000, 2] - 1.0)
    assert np.mean(off < 0.02) > 0.97, "but for what no scatter explains"
    assert np.abs(cloud.points[:4000, 2] - 1.0).max() > 0.1, "the cloud that was given is not changed"


def test_a_scan_is_never_moved() -> None:
    points, normals = floor_cloud(0.04)
    scan = Cloud(points)
    assert flatten_floor(scan, FloorSurface.flat(0.0)) is scan
    both = Cloud(np.concatenate([points, points]), None, "lidar", np.concatenate([0 * normals, normals]))
    found = flatten_floor(both, FloorSurface.flat(0.0)).points
    assert np.array_equal(found[:4000], points) and not np.array_equal(found[4000:], points)


def test_without_it_the_scatter_of_a_floor_is_taken_for_obstacles() -> None:
    points, normals = floor_cloud(0.04)
    cloud, floor, c = Cloud(points, None, "images", normals), FloorSurface.flat(0.0), ObstacleConfig()
    noisy, calm = (len(split_obstacles(one, floor, c).points) for one in (cloud, flatten_floor(cloud, floor)))
    assert noisy > 400 and calm < 0.2 * noisy
