"""A storey seen from its viewpoints, as voxels: ground cells and height levels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.quantities import slope_of
from nvsim.graph.types import NavGraph
from nvsim.r2r.surroundings.visibility import ViewFromViewpoint

Scalar = TypeVar("Scalar", bound=np.generic)
CELL = 0.05
"""Size of a cell and of a voxel in meters."""
FLOOR = 0.06
"""Points up to this many meters above or below the floor height belong to the floor."""
_LOWEST, _HIGHEST = -0.3, 3.2  # meters above the floor
_LEVELS = round((_HIGHEST - _LOWEST) / CELL)
_APART = 0.4  # smallest distance in meters between the floors of two storeys
_FEW = 3  # viewpoints; a smaller level part with stairs is a landing
_LEAST = 2  # smallest number of points in a voxel
_CEILING = (1.95, 3.2)  # meters above the floor between which the ceiling is searched
_NEARBY = 4.0  # meters within which views resolve voxels
_PASSED = 1.0  # largest ratio of views past a voxel to views of it
_HIGH = 0.45  # meters below the ceiling that have no furniture


@dataclass(frozen=True, eq=False)
class Layers:
    """A storey as its viewpoints `seen` see it.

    low      (x, y) meters of the lower corner of cell [0, 0]; rows follow y, columns x
    voxels   (n, 3) int32 column, row and level; level l is CELL * l above -0.3 m
    colors   (n, 3) float32 mean color of each voxel, 0 to 255
    shape    rows, columns
    high     meters above the floor between which there are only walls, lintels and hanging objects
    """

    seen: tuple[ViewFromViewpoint, ...]
    floor: float
    low: tuple[float, float]
    voxels: NDArray[np.int32]
    colors: NDArray[np.float32]
    shape: tuple[int, int]
    high: tuple[float, float]

    @property
    def height_above_floor(self) -> NDArray[np.float32]:
        """(n,) meters from the floor to the voxel centers."""
        return ((self.voxels[:, 2] + 0.5) * CELL + _LOWEST).astype(np.float32)

    def count_between(self, low: float, high: float) -> NDArray[np.int64]:
        """Returns (rows, columns) the number of voxels with centers from `low` to `high` meters above the floor."""
        above = self.height_above_floor
        return self.count_per_cell((above >= low) & (above < high))

    def is_confirmed(self, low: float, high: float) -> NDArray[np.bool_]:
        """Returns (n,) bool: voxels from `low` to `high` meters above the floor that nearby viewpoints confirm.

        Voxels that one viewpoint sees but more viewpoints see past are not included.
        """
        above = self.height_above_floor
        rows = np.flatnonzero((above >= low) & (above < high))
        places = self.places_of(rows)
        on, past = np.zeros(len(rows)), np.zeros(len(rows))
        for one in self.seen:
            offs = np.hypot(*(places[:, :2] - one.viewpoint.position[:2]).T)
            near = np.flatnonzero(offs < _NEARBY)
            there, beyond = one.visible_and_passed(places[near])
            on[near] += there
            past[near] += beyond
        found = np.zeros(len(self.voxels), bool)
        found[rows[past <= _PASSED * on]] = True
        return found

    def count_per_cell(self, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Returns (rows, columns) the number of voxels among `chosen` (n,) bool."""
        inside = self.voxels[chosen]
        flat = inside[:, 1].astype(np.int64) * self.shape[1] + inside[:, 0]
        return np.bincount(flat, minlength=self.shape[0] * self.shape[1]).reshape(self.shape)

    def cells_of(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """Returns (..., 2) row and column of world places (..., 2 or more), meters; may be out of range."""
        at = np.floor((np.asarray(xy)[..., :2] - self.low) / CELL).astype(np.int64)
        return at[..., ::-1]

    def centers_of(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """Returns (..., 2) world x, y in meters of the centers of cells (..., 2)."""
        return (cells[..., ::-1] + 0.5) * CELL + np.array(self.low)

    def places_of(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> NDArray[np.float64]:
        """Returns (n, 3) the centers of voxels, meters, world."""
        v = self.voxels[rows]
        xy = (v[:, :2] + 0.5) * CELL + np.array(self.low)
        return np.column_stack([xy, (v[:, 2] + 0.5) * CELL + _LOWEST + self.floor])

    def values_at(self, values: NDArray[Scalar], xy: NDArray[np.floating]) -> NDArray[Scalar]:
        """Returns (...) entries of `values` (rows, columns) at world places (..., 2 or more), clipped to the grid."""
        at = self.cells_of(xy)
        return values[at[..., 0].clip(0, self.shape[0] - 1), at[..., 1].clip(0, self.shape[1] - 1)]


def labels_of_voxels(layers: Layers) -> NDArray[np.uint8]:
    """Returns (n,) the number of the object that most points in a voxel show, 0 for none."""
    rows, columns = layers.shape
    pairs, counts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for one in layers.seen:
        if one.labels is None:
            continue
        at = np.floor((one.points - (*layers.low, one.floor + _LOWEST)) / CELL).astype(np.int64)
        inside = ((at >= 0) & (at < (columns, rows, _LEVELS))).all(axis=1)
        key = ((at[inside, 2] * rows + at[inside, 1]) * columns + at[inside, 0]) << 8 | one.labels[inside]
        found = np.unique(key, return_counts=True)
        pairs.append(found[0])
        counts.append(found[1])
    every, back = np.unique(np.concatenate(pairs), return_inverse=True)
    if not len(every):
        return np.zeros(len(layers.voxels), np.uint8)
    votes = np.bincount(back, np.concatenate(counts), len(every))
    order = np.lexsort((votes, every >> 8))  # the most votes of a voxel are last
    winners = every[order[np.flatnonzero(np.diff(every[order] >> 8, append=-1))]]
    v = layers.voxels.astype(np.int64)
    keys = (v[:, 2] * rows + v[:, 1]) * columns + v[:, 0]
    at = winners[np.searchsorted(winners >> 8, keys).clip(0, len(winners) - 1)]
    return np.where(at >> 8 == keys, at & 255, 0).astype(np.uint8)


def layers_of(seen: Sequence[ViewFromViewpoint], graph: NavGraph) -> Iterator[Layers]:
    """Yields the storeys from the lowest: viewpoints joined by level edges, and parts of equal height.

    Viewpoints on stairs belong to no storey, because their heights differ from the others.
    """
    groups: list[list[ViewFromViewpoint]] = []
    for part in sorted(_level_parts(seen, graph), key=len, reverse=True):
        same = [group for group in groups if abs(_floor(group) - _floor(part)) < _APART]
        if same:
            same[0].extend(part)
        else:
            groups.append(part)
    return (_layers(tuple(group)) for group in sorted(groups, key=_floor))


def _level_parts(seen: Sequence[ViewFromViewpoint], graph: NavGraph) -> Iterator[list[ViewFromViewpoint]]:
    """Yields the viewpoints that level edges join, without landings of stairs."""
    import networkx as nx

    by_id = {one.viewpoint.id: one for one in seen}
    level, climbing = nx.Graph(), set()
    level.add_nodes_from(by_id)
    for a, b in graph.edges:
        if a in by_id and b in by_id:
            rise = by_id[b].floor - by_id[a].floor
            if slope_of(rise, math.dist(by_id[a].viewpoint.position, by_id[b].viewpoint.position)) == "level":
                level.add_edge(a, b)
            else:
                climbing |= {a, b}
    for ids in nx.connected_components(level):
        if len(ids) >= _FEW or not ids & climbing:
            yield [one for one in seen if one.viewpoint.id in ids]


def _floor(seen: Sequence[ViewFromViewpoint]) -> float:
    return float(np.median([one.floor for one in seen]))


def _layers(seen: tuple[ViewFromViewpoint, ...]) -> Layers:
    places = np.array([s.viewpoint.position[:2] for s in seen])
    low = np.floor((places.min(axis=0) - 8.0) / CELL) * CELL
    columns, rows = (np.ceil((places.max(axis=0) + 8.0 - low) / CELL)).astype(int).tolist()
    keys, sums, counts = np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0, np.int64)
    for one in seen:
        at = np.empty(one.points.shape, np.int64)
        at[:, :2] = np.floor((one.points[:, :2] - low) / CELL)
        at[:, 2] = np.floor((one.points[:, 2] - one.floor - _LOWEST) / CELL)
        inside = ((at >= 0) & (at < (columns, rows, _LEVELS))).all(axis=1)
        key = (at[inside, 2] * rows + at[inside, 1]) * columns + at[inside, 0]
        keys, sums, counts = _add_to_sums(keys, sums, counts, key, one.colors[inside])
    kept = counts >= _LEAST
    keys, sums, counts = keys[kept], sums[kept], counts[kept]
    level, cell = np.divmod(keys, rows * columns)
    row, column = np.divmod(cell, columns)
    voxels = np.stack([column, row, level], axis=1).astype(np.int32)
    colors = (sums / counts[:, None]).astype(np.float32)
    floor = _floor(seen)
    where = float(low[0]), float(low[1])
    return Layers(seen, floor, where, voxels, colors, (rows, columns), _high_of(voxels[:, 2]))


def _add_to_sums(
    keys: NDArray[np.int64], sums: NDArray[np.float32], counts: NDArray[np.int64],
    key: NDArray[np.int64], colors: NDArray[np.uint8],
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:  # fmt: skip
    """Adds points to the voxel sums."""
    new, back, count = np.unique(key, return_inverse=True, return_counts=True)
    added = np.stack([np.bincount(back, colors[:, i], len(new)) for i in range(3)], axis=1)
    both, place = np.unique(np.concatenate([keys, new]), return_inverse=True)
    all_sums, all_counts = np.zeros((len(both), 3), np.float32), np.zeros(len(both), np.int64)
    all_sums[place[: len(keys)]], all_counts[place[: len(keys)]] = sums, counts
    all_sums[place[len(keys) :]] += added.astype(np.float32)
    all_counts[place[len(keys) :]] += count
    return both, all_sums, all_counts


def _high_of(levels: NDArray[np.int32]) -> tuple[float, float]:
    """Returns the band below the ceiling, which is the level above head height with the most voxels."""
    first, last = (round((z - _LOWEST) / CELL) for z in _CEILING)
    counts = np.bincount(levels[(levels >= first) & (levels < last)], minlength=last)
    ceiling = int(counts.argmax()) * CELL + _LOWEST if counts.any() else 2.7
    top = ceiling - 0.1
    return top - _HIGH, top
