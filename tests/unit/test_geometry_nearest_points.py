"""How far points lie apart, held to a k-d tree, and the depth of points in cubes to one that looks at them all."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.cells import distinct_cells
from nvsim.geometry.nearest_points import axes_of, distance_and_normals, distance_to
from nvsim.geometry.splatting import SplatCloud

RNG = np.random.default_rng(0)
CLOUDS = {
    "surface": np.column_stack([RNG.uniform(0, 6, (20_000, 2)), RNG.normal(0, 0.01, 20_000)]),
    "heap and strays": np.concatenate([RNG.normal(0, 0.05, (5000, 3)), RNG.uniform(-60, 60, (300, 3)), [[500, 0, 0]]]),
    "grid": np.stack(np.meshgrid(*[np.arange(12) * 0.05] * 3), axis=-1).reshape(-1, 3),
    "one place": np.ones((50, 3)),
    "three": RNG.normal(size=(3, 3)),
    "one": np.zeros((1, 3)),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_the_fourth_neighbor_is_as_far_as_a_tree_says(name: str) -> None:
    points = CLOUDS[name].astype(np.float32)
    distance, _ = cKDTree(points).query(points, k=min(5, len(points)))
    expected = np.asarray(distance, np.float32).reshape(len(points), -1)[:, -1]
    np.testing.assert_array_equal(distance_to(points, 4), expected)


@pytest.mark.parametrize("name", CLOUDS)
def test_normals_are_the_axes_of_the_neighbors_that_a_tree_finds(name: str) -> None:
    points = CLOUDS[name].astype(np.float32)
    wanted, count = np.arange(0, len(points), 3), min(24, len(points))
    distance, index = cKDTree(points).query(points[wanted], k=np.arange(1, count + 1))
    found, normals = distance_and_normals(points, 24, wanted)
    np.testing.assert_array_equal(found, np.asarray(distance, np.float32)[:, -1])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    around = points[index].astype(np.float64)
    around -= around.mean(axis=1, keepdims=True)
    spread = ((around @ normals[..., None]) ** 2).sum(axis=(1, 2))
    least = ((around @ axes_of(around)[:, :, :1]) ** 2).sum(axis=(1, 2))
    alike = spread <= 1.001 * least + 1e-9
    # At equal distances, either point can be a neighbor.
    assert alike.mean() > (0.999 if name != "grid" else 0.2)


def test_no_points_lie_nowhere() -> None:
    assert distance_to(np.zeros((0, 3), np.float32), 4).shape == (0,)


def _all_depths(points: NDArray[np.float32], radii: NDArray[np.float32], camera: Camera) -> NDArray[np.float64]:
    """The same, point by point."""
    k = camera.intrinsics
    depth = np.full((k.height, k.width), np.inf)
    pixels, deep = camera.project(points)
    for (u, v), z, half in zip(pixels, deep, np.minimum(radii * k.fx / np.maximum(deep, 0.05), 24.0), strict=True):
        if z < 0.05:
            continue
        low, high = np.ceil(np.array([u, v]) - half - 0.5), np.floor(np.array([u, v]) + half - 0.5)
        small = high < low
        low[small] = high[small] = np.floor([u, v])[small]
        c0, r0 = np.maximum(low, 0).astype(int)
        c1, r1 = np.minimum(high, [k.width - 1, k.height - 1]).astype(int)
        if c1 >= c0 and r1 >= r0:
            depth[r0 : r1 + 1, c0 : c1 + 1] = np.minimum(depth[r0 : r1 + 1, c0 : c1 + 1], z)
    return depth


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.5, 4.0])
def test_a_camera_misses_none_of_the_points_that_it_sees(heading: float) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform((-9, -9, -1), (9, 9, 3), (3000, 3)).astype(np.float32)
    radii = rng.uniform(0.02, 0.2, 3000).astype(np.float32)
    camera = Camera(Intrinsics.from_fov(96, 64, np.radians(80)), camera_pose(np.array([0.3, -0.2, 1.4]), heading, -0.3))
    cloud = SplatCloud.of(points, radii)
    depth, extent = cloud.depth(camera)
    expected = _all_depths(points, radii, camera)
    # A square whose edge falls on a pixel's middle is rounded to either side in single precision.
    assert np.isclose(depth, expected, rtol=1e-5).mean() > 0.999
    assert ((extent > 0) == np.isfinite(depth)).all()
    near = cloud.depth(camera, farthest=4.0)[0]
    same = expected < 4.0 * np.cos(np.radians(50))
    assert same.any() and np.isclose(near, expected, rtol=1e-5)[same].mean() > 0.999


@pytest.mark.parametrize("heading", [0.0, 0.4, 1.5])
def test_what_a_near_wall_hides_is_not_drawn_and_its_gaps_and_edges_show_what_is_behind(heading: float) -> None:
    rng = np.random.default_rng(5)
    wall = np.stack(np.meshgrid(np.arange(-3, 3, 0.1), [2.0], np.arange(0, 2.2, 0.1)), axis=-1).reshape(-1, 3)
    gap = (np.abs(wall[:, 0] - 0.5) < 0.25) & (np.abs(wall[:, 2] - 1.2) < 0.2)
    room = rng.uniform((-8, 3, 0), (8, 12, 3), (1500, 3))
    points = np.concatenate([wall[~gap], room]).astype(np.float32)
    radii = np.concatenate([np.full((~gap).sum(), 0.06), rng.uniform(0.02, 0.2, len(room))]).astype(np.float32)
    camera = Camera(Intrinsics.from_fov(96, 64, np.radians(70)), camera_pose(np.array([0.1, 0.2, 1.3]), heading, -0.1))
    drawn = SplatCloud.of(points, radii).depth(camera)[0]
    expected = _all_depths(points, radii, camera)
    behind = np.isfinite(expected) & (expected > 2.6)
    assert 10 < behind.sum() < 0.8 * expected.size
    assert np.isclose(drawn, expected, rtol=1e-5).mean() > 0.999


def test_of_points_equally_deep_the_first_shows_whatever_cube_it_is_in() -> None:
    points = np.array([[0.05, 3, 0], [-0.05, 3, 0]], np.float32)
    camera = Camera(Intrinsics.from_fov(64, 64, np.radians(60)), camera_pose(np.zeros(3), 0.0))
    for radii in ([0.2, 0.1], [0.1, 0.2]):
        for order in (slice(None), slice(None, None, -1)):
            cloud = SplatCloud.of(points[order], np.array(radii, np.float32)[order])
            assert cloud.depth(camera)[1][32, 32] == np.float32(np.array(radii)[order][0])
            wider = SplatCloud.of(points, np.array([0.3, 0.4], np.float32))
            assert wider.depth(camera)[1][32, 32] == np.float32(0.3)


@pytest.mark.parametrize("far", [5, 10**12])
def test_distinct_cells_are_those_of_numpy(far: int) -> None:
    cells = np.concatenate([RNG.integers(-4, 5, (500, 3)), [[far, -far, far]]])
    expected, member = np.unique(cells, axis=0, return_inverse=True)
    found, which = distinct_cells(cells)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(which, member.reshape(-1))
    assert distinct_cells(np.zeros((0, 2), np.int64))[1].shape == (0,)
