"""Obstacles of a building with several submaps, held to those of its whole cloud."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.lens import Lens
from nvsim.perception.obstacles import BuildingObstacles, ObstacleConfig, split_obstacles

NEAR = ObstacleConfig(farthest=8.0)
LENGTH, WIDTH, STEP = 60.0, 6.0, 0.06
LENS = Lens("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0))


def hall(floor: float = 0.0) -> NDArray[np.float32]:
    """Points (N, 3) of a long hall: floor, walls along it, and a box in every five meters, also across the border of
    submaps."""
    rng = np.random.default_rng(1)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, LENGTH, STEP), np.arange(0, WIDTH, STEP)))
    along, up = (a.ravel() for a in np.meshgrid(np.arange(0, LENGTH, STEP), np.arange(0.04, 2.5, STEP)))
    parts = [np.column_stack([x, y, 0 * x])]
    parts += [np.column_stack([along, 0 * along + side, up]) for side in (0.0, WIDTH)]
    in_box = (np.abs(x % 5 - 2.5) < 0.5) & (np.abs(y - 4) < 0.5)
    parts.append(np.column_stack([x, y, 0 * x + 0.8])[in_box])
    points = np.concatenate(parts) + rng.uniform(-0.005, 0.005, (sum(map(len, parts)), 3))
    return (points + [0, 0, floor]).astype(np.float32)


def capture(cloud: NDArray[np.float32], levels: tuple[float, ...] = (0.0,)) -> Capture:
    """Frames along the hall on each of the `levels`."""
    places = [(x, 2.0, level + 1.5) for level in levels for x in np.arange(1.0, LENGTH, 1.0)]
    frames = [
        Frame(f"{i}.png", Path(f"{i}.png"), LENS, camera_pose(np.array(place), 0.0)) for i, place in enumerate(places)
    ]
    return Capture(Path("."), "nerfstudio", tuple(frames), Cloud(cloud), Alignment.identity())


def rows(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Points (N, 3) in ascending order."""
    return points[np.lexsort(points.T)]


def test_each_submap_finds_the_obstacles_of_the_whole_building_near_its_frames() -> None:
    whole = hall()
    taken = capture(whole)
    positions = taken.positions
    surfaces = [FloorSurface.flat(0.0) for _ in range(4)]
    owner = np.minimum(positions[:, 0] // 15, 3).astype(int)
    found = BuildingObstacles(taken, [surfaces[k] for k in owner], NEAR)
    expected = split_obstacles(taken.cloud, surfaces[0], NEAR)
    for k in range(4):
        members = np.flatnonzero(owner == k)
        here = found.near(members, members)
        low, high = positions[members, 0].min(), positions[members, 0].max()

        def inside(points: NDArray[np.float32], low: float = low, high: float = high) -> NDArray[np.bool_]:
            return (points[:, 0] > low - 8) & (points[:, 0] < high + 8)

        assert len(here.points) < 0.8 * len(expected.points)
        # A foot is the mean of the lowest points of its cell, in which the scatter does not change.
        right, own = inside(expected.points), inside(here.points)
        np.testing.assert_array_equal(rows(here.points[own]), rows(expected.points[right]))
        radii = here.radii[own][np.lexsort(here.points[own].T)]
        same = np.isclose(radii, expected.radii[right][np.lexsort(expected.points[right].T)])
        assert same.mean() > 0.98, "at the end of the ground, neighbors are missing"
        x = np.arange(max(low - 7.5, 0.2), min(high + 7.5, LENGTH - 0.2), 0.1)
        places = np.stack(np.meshgrid(x, np.arange(0.2, WIDTH - 0.2, 0.1)), axis=-1)
        assert here.confirmed is not None and expected.confirmed is not None
        agree = here.confirmed.is_supported(places) == expected.confirmed.is_supported(places)
        assert agree.mean() > 0.99


def test_on_two_storeys_the_ground_is_divided_for_each() -> None:
    """Halls one above the other: the upper floor is no floor for the lower cameras, but an obstacle above them."""
    taken = capture(np.concatenate([hall(), hall(3.0)]), (0.0, 3.0))
    storey, half = taken.positions[:, 2] > 3.0, taken.positions[:, 0] > 30
    surfaces = {(up, far): FloorSurface.flat(3.0 * up) for up in (False, True) for far in (False, True)}
    found = BuildingObstacles(taken, [surfaces[bool(u), bool(f)] for u, f in zip(storey, half, strict=True)], NEAR)
    for up, ground in ((False, 0.0), (True, 3.0)):
        members = np.flatnonzero((storey == up) & ~half)
        here = found.near(members, members)
        expected = split_obstacles(taken.cloud, FloorSurface.flat(ground), NEAR)
        left = expected.points[expected.points[:, 0] < 30]
        np.testing.assert_array_equal(rows(here.points[here.points[:, 0] < 30]), rows(left))
        assert here.confirmed is not None and here.confirmed.is_supported(np.array([[10.0, 1.0]])).all()
    assert here.points[:, 2].min() > 3.0


def test_frames_without_a_cloud_have_no_obstacles() -> None:
    taken = Capture(Path("."), "nerfstudio", capture(hall()).frames, None, Alignment.identity())
    found = BuildingObstacles(taken, [FloorSurface.flat(0.0)] * len(taken.frames), NEAR).near([0], [0, 1])
    assert len(found.points) == 0 and found.confirmed is None
