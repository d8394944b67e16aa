"""Ray casting compared with OctoMap on the same scans, and with a slow reference."""

from __future__ import annotations

import struct
from itertools import count
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from octomap_samples import REACH, RESOLUTION, full_tree, scans

from nvsim.errors import InputError
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.occupancy.ray_grid import ODDS, RayGrid
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights

Voxel = tuple[int, int, int]


def passed(start: np.ndarray, end: np.ndarray) -> set[Voxel]:
    """The voxels of a segment, in voxels, without the last: from crossing to crossing of the planes between them."""
    crossings = {0.0, 1.0}
    for a, b in zip(start.tolist(), end.tolist()):
        low, high = sorted((a, b))
        crossings |= {(plane - a) / (b - a) for plane in range(int(np.ceil(low)), int(np.floor(high)) + 1) if a != b}
    along = np.array(sorted(t for t in crossings if 0 <= t <= 1))
    middles = start + ((along[1:] + along[:-1]) / 2)[:, None] * (end - start)
    found = {voxel(m) for m in middles[np.diff(along) > 1e-12]}
    return found - {voxel(end)}


def voxel(place: np.ndarray) -> Voxel:
    x, y, z = np.floor(place).astype(int).tolist()
    return x, y, z


def reference(some: list[tuple[np.ndarray, np.ndarray]], resolution: float, reach: float) -> dict[Voxel, np.float32]:
    """Log-odds by a dictionary of voxels and sets of them (OctoMap's insertPointCloud, not discretised)."""
    odds: dict[Voxel, np.float32] = {}
    hit, miss, least, most = ODDS
    for points, origin in some:
        occupied: set[Voxel] = set()
        free: set[Voxel] = set()
        for point in points:
            length = float(np.linalg.norm(point - origin))
            if length <= reach:
                occupied.add(voxel(point / resolution))
            else:
                point = origin + (point - origin) * (reach / length)
            free |= passed(origin / resolution, point / resolution)
        for v in free - occupied:
            odds[v] = max(np.float32(odds.get(v, np.float32(0)) + miss), least)
        for v in occupied:
            odds[v] = min(np.float32(odds.get(v, np.float32(0)) + hit), most)
    return odds


def leaves(data: bytes) -> dict[Voxel, float]:
    """Log-odds of the voxels of a full tree, from the world's zero."""
    body = data.partition(b"\ndata\n")[2]
    found: dict[Voxel, float] = {}
    at = count(0, 5)

    def read(x: int, y: int, z: int, size: int) -> None:
        value, bits = struct.unpack_from("<fB", body, next(at))
        if not bits:
            corner = np.array([x, y, z]) - (1 << 15)
            for offset in np.ndindex(size, size, size):
                found[voxel(corner + offset)] = value
        for i in range(8):
            if bits >> i & 1:
                half = size // 2
                read(x + half * (i & 1), y + half * (i >> 1 & 1), z + half * (i >> 2), half)

    read(0, 0, 0, 1 << 16)
    return found


def log_odds_at(grid: RayGrid, places: np.ndarray) -> np.ndarray:
    """(N,) float32 log-odds of the voxels at `places` (N, 3), meters, world; 0 if unknown, NaN outside the band."""
    at = np.floor(grid._in_voxels(places)).astype(np.int64)
    rows, columns = grid._base.shape
    inside = (at[:, 0] >= 0) & (at[:, 0] < columns) & (at[:, 1] >= 0) & (at[:, 1] < rows)
    c, r = np.where(inside, at[:, 0], 0), np.where(inside, at[:, 1], 0)
    k = at[:, 2] - grid._base[r, c]
    inside &= (k >= 0) & (k < grid.band)
    found = grid._log_odds[np.where(inside, (r * columns + c) * grid.layers + k, 0)]
    return np.where(inside, found, np.float32(np.nan))


def grid(resolution: float, side: float, heights: Heights, floor: FloorSurface | None = None, **more: Any) -> RayGrid:
    return RayGrid(
        np.array([-side, -side]), np.array([side, side]), resolution, floor or FloorSurface.flat(0.0), heights, **more
    )


def test_log_odds_are_those_that_octomap_wrote() -> None:
    made = grid(RESOLUTION, 3.0, Heights(-3.0, 3.0))
    for points, origin in scans():
        made.add(points, origin, REACH)
    theirs = leaves(full_tree())
    assert len(theirs) > 300 and {-2.0, 3.511} < {round(v, 3) for v in theirs.values()}, "some are clamped"
    span = np.arange(-11, 11)
    places = np.stack(np.meshgrid(span, span, span), axis=-1).reshape(-1, 3)
    ours = log_odds_at(made, (places + 0.5) * RESOLUTION)
    expected = [theirs.get(voxel(v), 0.0) for v in places]
    assert ours.tolist() == np.array(expected, np.float32).tolist()


@settings(max_examples=15)
@given(st.integers(0, 2**31), st.sampled_from([0.05, 0.11, 0.3]), st.sampled_from([0.9, np.inf]))
def test_log_odds_are_those_of_a_slow_reference(seed: int, resolution: float, reach: float) -> None:
    rng = np.random.default_rng(seed)
    some = [(rng.uniform(-1, 1, (30, 3)), rng.uniform(-0.9, 0.9, 3)) for _ in range(4)]
    made = grid(resolution, 1.2, Heights(-1.2, 1.2))
    for points, origin in some:
        made.add(points, origin, reach)
    expected = reference(some, resolution, reach)
    span = np.arange(-int(1 / resolution) - 1, int(1 / resolution) + 1)
    places = np.stack(np.meshgrid(span, span, span), axis=-1).reshape(-1, 3)
    ours = log_odds_at(made, (places + 0.5) * resolution)
    found = {voxel(v): value for v, value in zip(places, ours, strict=True) if value != 0}
    assert found == expected


def test_rays_that_leave_the_map_free_what_lies_in_it() -> None:
    made = grid(0.1, 0.5, Heights(0.0, 1.0))
    made.add(np.array([[3.0, 0.01, 0.55]]), np.array([-2.0, 0.01, 0.55]))
    xs = np.arange(-0.45, 0.5, 0.1)
    row = np.stack([xs, np.full_like(xs, 0.01), np.full_like(xs, 0.55)], axis=1)
    assert (log_odds_at(made, row) < 0).all()
    assert np.count_nonzero(made.flat().cells == UNKNOWN) == made.flat().cells.size, "no ray came near the foot"


def test_more_voxels_than_were_expected_are_counted_all() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (4000, 3)) * [5, 5, 1]
    together, apart = grid(0.02, 5.0, Heights(-1.0, 1.0)), grid(0.02, 5.0, Heights(-1.0, 1.0))
    together.add(points, np.zeros(3))
    apart.add(points, np.broadcast_to(np.zeros(3), points.shape))
    assert together.steps > 500_000  # the list of what a scan touches begins shorter
    probe = rng.uniform(-1, 1, (5000, 3)) * [5, 5, 1]
    assert np.array_equal(log_odds_at(together, probe), log_odds_at(apart, probe))


def around(x: float, y: float, half: float, z: np.ndarray) -> np.ndarray:
    """Points on the four sides of a box."""
    along = np.arange(-half, half, 0.02)
    sides = [(along, -half), (along, half), (-half, along), (half, along)]
    ring = np.concatenate([np.stack(np.broadcast_arrays(x + a, y + b), axis=1) for a, b in sides])
    return np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in z])


def ground(surface: FloorSurface, side: float) -> np.ndarray:
    xy = np.stack(np.meshgrid(*[np.arange(-side, side, 0.03)] * 2), axis=-1).reshape(-1, 2) + 0.001
    return np.column_stack([xy, surface.height_at(xy)])


def test_a_ramp_is_free_and_a_box_on_it_is_not() -> None:
    heights = np.tile(np.linspace(-0.5, 0.5, 11, dtype=np.float32), (11, 1))  # a slope of 1 in 4
    ramp = FloorSurface(heights, (-2.0, -2.0), 0.4)
    made = grid(0.05, 2.0, Heights(), ramp)
    box = around(1.0, 0.5, 0.2, np.arange(0.0, 0.8, 0.02) + 0.25)
    for sensor in ([-1.5, 0.0, 0.8], [1.5, 0.0, 1.5], [1.0, 1.6, 1.4], [0.0, -1.5, 1.2]):
        seen = np.concatenate([ground(ramp, 1.9), box])
        made.add(seen, np.array(sensor))
    found = made.flat()
    assert found.states_at(np.array([[1.0, 0.3], [1.0, 0.7], [0.8, 0.5], [1.2, 0.5]])).tolist() == [OCCUPIED] * 4
    walked = np.array([[x, y] for x in np.arange(-1.7, 1.7, 0.1) for y in (-1.0, 0.0, 1.2)])
    assert (found.states_at(walked) == FREE).all()


def test_a_column_is_free_only_where_a_ray_passed_at_its_foot() -> None:
    made = grid(0.05, 2.0, Heights())
    made.add(np.array([[1.5, 0.01, 1.21]]), np.array([-1.5, 0.01, 1.21]))
    made.add(np.array([[1.5, 0.51, 0.21]]), np.array([-1.5, 0.51, 0.21]))
    found = made.flat()
    assert found.states_at(np.array([[0.0, 0.01], [0.0, 0.51], [1.5, 0.01]])).tolist() == [UNKNOWN, FREE, OCCUPIED]


@pytest.mark.parametrize(("height", "expected"), [(0.8, FREE), (0.2, OCCUPIED)])
def test_what_floats_is_free_and_what_stands_is_not(height: float, expected: int) -> None:
    made = grid(0.05, 2.0, Heights())
    for sensor in ([-1.5, -1.0, 1.2], [1.4, 1.3, 1.2]):
        made.add(np.concatenate([ground(FloorSurface.flat(0.0), 1.9), [[0.31, 0.31, height]]]), np.array(sensor))
    assert made.flat().states_at(np.array([[0.31, 0.31]])).tolist() == [expected]


def test_a_merged_scan_frees_nothing_behind_its_own_walls() -> None:
    wall = np.array([[0.01, y, z] for y in np.arange(-1.9, 1.9, 0.02) for z in np.arange(0.0, 2.0, 0.02)])
    floor = ground(FloorSurface.flat(0.0), 1.9)
    made = grid(0.05, 2.0, Heights(), top=1.4)
    hidden = made.add_merged(np.concatenate([wall, floor]), np.array([[-1.0, 0.0, 1.2], [-0.8, 0.9, 1.2]]))
    found = made.flat()
    behind = np.array([[x, y] for x in np.arange(0.2, 1.7, 0.1) for y in np.arange(-1.5, 1.5, 0.1)])
    assert (found.states_at(behind) == UNKNOWN).all() and (found.states_at(-behind) == FREE).all()
    assert (found.states_at(np.array([[0.01, y] for y in np.arange(-1.8, 1.8, 0.05)])) == OCCUPIED).all()
    assert np.count_nonzero(floor[:, 0] > 0.1) <= hidden <= np.count_nonzero(floor[:, 0] > 0) + 0.05 * len(wall)


@settings(max_examples=25)
@given(st.integers(0, 2**31))
def test_what_a_scan_hits_it_does_not_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.3, 0.3, (200, 3))  # so close that most voxels are hit and passed
    made = grid(0.1, 0.5, Heights(-0.5, 0.5))
    made.add(points, rng.uniform(-0.3, 0.3, 3))
    assert (log_odds_at(made, points) == ODDS[0]).all()


@pytest.mark.parametrize(
    ("resolution", "side", "words"), [(0.0, 1.0, "--resolution"), (0.05, 1e4, "span"), (0.05, 1e2, "memory")]
)
def test_a_map_that_no_memory_holds_is_refused(resolution: float, side: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        grid(resolution, side, Heights(0.0, 4.0))


@pytest.mark.parametrize("heights", [(1.5, 0.1), (0.5, 0.5), (float("nan"), 1.0), (0.0, float("inf"))])
def test_heights_without_anything_between_them_are_refused(heights: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="--from-height"):
        Heights(*heights)
