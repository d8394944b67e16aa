"""Ways over the cells of a grid against the Dijkstra of scipy over a matrix of the same steps, made cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse import lil_matrix
from scipy.sparse.csgraph import dijkstra

from nvsim.occupancy.grid_ways import GridWays

CELL = 0.1


def touched(a: tuple[int, int], b: tuple[int, int]) -> set[tuple[int, int]]:
    """Cells whose inside the straight line between two middles runs through, or beside whose corner it passes."""
    (r, c), (dr, dc) = a, (b[0] - a[0], b[1] - a[1])
    if abs(dr) == abs(dc) == 1:
        return {(r + dr, c), (r, c + dc)}
    share = np.linspace(0, 1, 101)[1:-1]
    return {(round(r + s * dr), round(c + s * dc)) for s in share} - {a, b}


def reference(
    room: NDArray[np.bool_], start: tuple[int, int], cost_factors: NDArray[np.float64]
) -> NDArray[np.float64]:
    rows, columns = room.shape
    steps = lil_matrix((room.size, room.size))
    for r, c in zip(*np.nonzero(room), strict=True):
        for dr in (-2, -1, 0, 1, 2):
            for dc in (-2, -1, 0, 1, 2):
                there = r + dr, c + dc
                if math.gcd(dr, dc) != 1 or not (0 <= there[0] < rows and 0 <= there[1] < columns):
                    continue
                if room[there] and all(room[cell] for cell in touched((int(r), int(c)), there)):
                    length = math.hypot(dr, dc) * CELL * (cost_factors[r, c] + cost_factors[there]) / 2
                    steps[r * columns + c, there[0] * columns + there[1]] = length
    found = dijkstra(steps.tocsr(), indices=start[0] * columns + start[1])
    return np.asarray(found.reshape(room.shape))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("priced", [False, True])
def test_meters_are_those_of_the_matrix_of_steps(seed: int, priced: bool) -> None:
    rng = np.random.default_rng(seed)
    room = gaussian_filter(rng.normal(size=(21, 26)), 1.5) > -0.08
    start = (10, 13)
    room[start] = True
    cost_factors = 1 + rng.random(room.shape)
    found = GridWays(room, CELL, start, cost_factors=cost_factors if priced else None)
    np.testing.assert_allclose(found.meters, reference(room, start, cost_factors if priced else np.ones(room.shape)))


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, (7, 9)), st.tuples(st.integers(0, 6), st.integers(0, 8)))
def test_a_way_goes_over_room_alone_and_is_as_long_as_it_says(room: NDArray[np.bool_], end: tuple[int, int]) -> None:
    ways = GridWays(room, CELL, (3, 4))
    if not np.isfinite(ways.meters[end]):
        return
    cells = ways.cells_to(end)
    assert tuple(cells[0]) == (3, 4) and tuple(cells[-1]) == end
    assert all(room[tuple(cell)] for cell in cells[1:])
    assert np.hypot(*np.diff(cells, axis=0).T).sum() * CELL == pytest.approx(ways.meters[end])


def test_what_nobody_asked_for_is_left() -> None:
    room = np.ones((31, 31), np.bool_)
    whole = GridWays(room, CELL, (15, 15))
    near = GridWays(room, CELL, (15, 15), reach=0.5)
    assert np.array_equal(np.isfinite(near.meters), whole.meters <= 0.5)
    ends = np.array([[15, 18], [12, 15], [-1, 5], [40, 2]])
    asked = GridWays(room, CELL, (15, 15), ends=ends)
    settled = np.isfinite(asked.meters)
    assert asked.meters[15, 18] == asked.meters[12, 15] == pytest.approx(0.3)
    assert np.array_equal(asked.meters[settled], whole.meters[settled]) and asked.meters[settled].max() <= 0.3 + 1e-9
    assert not np.isfinite(GridWays(room, CELL, (15, 15), ends=ends[2:]).meters[0, 0])


def test_a_corner_is_not_cut() -> None:
    room = np.array([[1, 1], [0, 1]], np.bool_)
    assert GridWays(room, CELL, (0, 0)).meters[1, 1] == pytest.approx(0.2)
    assert not np.isfinite(GridWays(np.eye(2, dtype=np.bool_), CELL, (0, 0)).meters[1, 1])
