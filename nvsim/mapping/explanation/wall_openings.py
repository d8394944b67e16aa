"""Find the openings of walls that the trajectory does not use, and tell where a glass pane may be. A pane beside a door
looks like such an opening in photographs, but the posts, frames, and ends of walls on both sides of it are visible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.cells import grid_size
from nvsim.mapping.corridor import HeightAt
from nvsim.mapping.evidence.traversed_floor import JUMP
from nvsim.mapping.explanation.seen_floor import SeenFloor
from nvsim.mapping.explanation.trajectory_detour import Camera, TrajectoryDetour
from nvsim.submaps.split import storeys_of

_CELL = 0.1  # meters
_BANDS = (0.3, 0.8, 1.3, 1.8, 2.2)  # meters above the floor; walls and posts have points between all of them
_FEW = 3  # points in a cell and its neighbors between two of these heights
_BLOCK = 1 << 20  # points that are counted at the same time, 100 MB
_SAMPLE = 50_000  # points that show the headings of the walls
_HEADINGS = np.radians(np.arange(0, 90, 0.5))  # headings of walls that are examined
_WIDEST = 7.0  # meters of the widest opening
_JAMB = 0.6  # meters by which the free width is larger before and behind an opening
_BEFORE = 0.4  # meters before and behind an opening in which it is larger: posts and ends of walls are thin
_DOOR = 3.5  # meters of the widest door
_ALONG = 8.0  # meters along a wall from an opening to a door
_STEEP = 0.15  # sine of the least angle between a line and a wall that it passes through
_SPACING = 0.05  # meters between the examined positions of a line
_ARRAYS = {"turn": ("f", 2), "origin": ("f", 1), "cells": ("bui", 2)}


@dataclass(frozen=True, eq=False)
class WallGrid:
    """The walls of one storey, seen from above, in cells of 0.1 m along their main directions.

    turn    (2, 2) rotation from world x and y to the grid's
    origin  (2,) meters, the lower corner of cell [0, 0] on the grid
    cells   (rows, columns) bool, True for walls and posts; row follows the grid's y, column its x
    """

    turn: NDArray[np.float64]
    origin: NDArray[np.float64]
    cells: NDArray[np.bool_]


def find_walls(
    points: NDArray[np.floating], floor_at: HeightAt, trajectory: NDArray[np.floating]
) -> tuple[WallGrid, ...]:
    """Return the walls that the cloud `points` (N, 3) shows on every storey of the cameras `trajectory` (M, 3), all in
    meters, world. `floor_at` gives the height of the floor at world points, whose z selects the storey."""
    return tuple(_walls_of_storey(points, floor_at, float(level)) for level in storeys_of(trajectory).levels)


def write_walls(path: Path, walls: tuple[WallGrid, ...]) -> None:
    """Writes an .npz file atomically. Raises InputError if it cannot be written."""
    arrays = {f"{name}_{k}": getattr(grid, name) for k, grid in enumerate(walls) for name in _ARRAYS}
    write_arrays(path, arrays)


def read_walls(path: Path, trajectory: NDArray[np.floating]) -> tuple[WallGrid, ...]:
    """Return the walls that `write_walls` wrote for the cameras `trajectory` (M, 3). Raises InputError if the file is
    missing, damaged, or has fewer storeys."""
    again, storeys = "run `nvsim map --project` again", len(storeys_of(trajectory).levels)
    wanted = {f"{name}_{k}": kind for k in range(storeys) for name, kind in _ARRAYS.items()}
    arrays = read_arrays(path, "the walls of a map", wanted, again)
    grids = tuple(
        WallGrid(arrays[f"turn_{k}"], arrays[f"origin_{k}"], arrays[f"cells_{k}"].astype(bool)) for k in range(storeys)
    )
    if any(grid.turn.shape != (2, 2) or grid.origin.shape != (2,) or not grid.cells.size for grid in grids):
        raise InputError(f"The walls {path} cannot be read (their values are not valid); {again}.")
    return grids


class WallOpenings:
    """The openings of walls, on every storey of a trajectory.

    An opening is a place at which the free width between two walls along a main direction is smaller than before and
    behind it, and at most 7 m. It is used if the trajectory passes through it."""

    def __init__(self, walls: Sequence[WallGrid], trajectory: NDArray[np.floating]) -> None:
        """`walls` are those of the storeys of `trajectory` (M, 3), cameras in order of time, meters, world."""
        self._storeys = storeys_of(trajectory)
        on = self._storeys.nearest(trajectory[:, 2])
        carried = np.linalg.norm(np.diff(trajectory, axis=0), axis=1) <= JUMP
        steps = np.stack([trajectory[:-1, :2], trajectory[1:, :2]], axis=1)
        self._walls = [
            _Openings(grid, steps[carried & ((on[:-1] == k) | (on[1:] == k))] @ grid.turn.T)
            for k, grid in enumerate(walls)
        ]

    def leads_through_unused(self, a: Camera, b: Camera, beside_door: bool) -> bool:
        """Whether the line between two cameras (x, y, z) passes through an unused opening. With `beside_door`, only
        openings in the line of a wall with a door that the trajectory uses count."""
        openings = self._walls[int(self._storeys.nearest(a[2]))]
        return any(openings.unused(np.array([a[:2], b[:2]]), beside_door))


class _Openings:
    """The openings of one storey. All coordinates are on its grid. Axis 0 is x, axis 1 is y."""

    def __init__(self, walls: WallGrid, steps: NDArray[np.float64]) -> None:
        """`steps` (K, 2, 2) are both ends of the steps of the trajectory on this storey."""
        self._turn, self._origin, self._steps = walls.turn, walls.origin, steps
        # For each axis, free meters to the next wall toward lower and toward higher coordinates.
        self._free = [(_free_meters(walls.cells, k, 1), _free_meters(walls.cells, k, -1)) for k in (1, 0)]

    def unused(self, ends: NDArray[np.float64], beside_door: bool) -> Iterator[bool]:
        """Yield True for every unused opening on the line between two world points `ends` (2, 2)."""
        a, b = ends @ self._turn.T
        meters = float(np.hypot(*(b - a)))
        way = (b - a) / max(meters, 1e-9)
        for axis in (0, 1):
            across = abs(way[1 - axis])
            if across < _STEEP:
                continue
            ahead = int(np.ceil(_BEFORE / across / _SPACING))
            count = int(np.ceil(meters / _SPACING)) + 1
            line = a + ((np.arange(count + 2 * ahead) - ahead) * _SPACING)[:, None] * way
            low, high = self._free_at(line, axis)
            width = low + high
            most = sliding_window_view(width, ahead).max(axis=1)
            before, behind, here = most[:count], most[ahead + 1 :], width[ahead : ahead + count]
            narrow = (here <= _WIDEST) & (np.minimum(before, behind) >= here + _JAMB)
            for i in np.flatnonzero(narrow) + ahead:
                if self._is_unused(axis, line[i], float(low[i]), float(high[i]), beside_door):
                    yield True

    def _is_unused(self, axis: int, place: NDArray[np.float64], low: float, high: float, beside_door: bool) -> bool:
        """Whether the trajectory does not pass through the opening at `place` (2,), which reaches `low` and `high`
        meters along `axis`. With `beside_door`, it must also pass through a door in the same line."""
        from_line, to_line = (self._steps[:, k, 1 - axis] - place[1 - axis] for k in (0, 1))
        passing = (from_line <= 0) != (to_line <= 0)
        share = from_line[passing] / (from_line[passing] - to_line[passing])
        start, end = self._steps[passing, 0, axis], self._steps[passing, 1, axis]
        where = start + share * (end - start)
        if ((where > place[axis] - low - _CELL) & (where < place[axis] + high + _CELL)).any():
            return False
        if not beside_door:
            return True
        near = (where > place[axis] - low - _ALONG) & (where < place[axis] + high + _ALONG)
        return bool(self._are_doors(axis, where[near], float(place[1 - axis])).any())

    def _are_doors(self, axis: int, where: NDArray[np.float64], line: float) -> NDArray[np.bool_]:
        """(K,) bool: whether a door is at the coordinates `where` (K,) along `axis` and `line` along the other axis.
        Unlike a corridor, it is narrower than the space before and behind it."""
        steps = round(_BEFORE / _CELL)
        places = np.empty((2 * steps + 1, len(where), 2))
        places[..., axis], places[..., 1 - axis] = where, line + _CELL * np.arange(-steps, steps + 1)[:, None]
        width = np.sum(self._free_at(places, axis), axis=0)
        door = width[steps - 1 : steps + 2].min(axis=0)
        around = np.minimum(width[:steps].max(axis=0), width[steps + 1 :].max(axis=0))
        return np.asarray((door <= _DOOR) & (around >= door + _JAMB))

    def _free_at(self, places: NDArray[np.float64], axis: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(...) free meters toward both sides along `axis` at places (..., 2), infinite outside of the grid."""
        column, row = np.moveaxis(np.floor((places - self._origin) / _CELL).astype(np.int64), -1, 0)
        rows, columns = self._free[0][0].shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
        low, high = (np.where(inside, side[row, column], np.float32(np.inf)) for side in self._free[axis])
        return low, high


def _walls_of_storey(points: NDArray[np.floating], floor_at: HeightAt, level: float) -> WallGrid:
    """The walls of the storey whose cameras are at the height `level`."""
    places, heights = [], []
    for start in range(0, len(points), _BLOCK):
        part = np.asarray(points[start : start + _BLOCK], np.float64)
        above = part[:, 2] - floor_at(np.column_stack([part[:, :2], np.full(len(part), level)]))
        inside = (above > _BANDS[0]) & (above < _BANDS[-1])
        places.append(part[inside, :2].astype(np.float32))
        heights.append(above[inside].astype(np.float32))
    if not any(len(some) for some in places):
        return WallGrid(np.eye(2), np.zeros(2), np.zeros((1, 1), bool))
    xy, above = np.concatenate(places), np.concatenate(heights)
    turn = _turn_to_walls(xy)
    xy = xy @ turn.T.astype(np.float32)
    low = xy.min(axis=0).astype(np.float64) - _CELL
    columns, rows = grid_size(low, xy.max(axis=0) + _CELL, _CELL, "the walls")
    cell = np.floor((xy - low) / _CELL).astype(np.int64) @ np.array([1, columns])
    band = np.searchsorted(_BANDS, above) - 1
    counts = [np.bincount(cell[band == k], minlength=rows * columns) for k in range(len(_BANDS) - 1)]
    return WallGrid(turn, low, _are_walls(np.stack(counts).reshape(-1, rows, columns)))


def _turn_to_walls(places: NDArray[np.float32]) -> NDArray[np.float64]:
    """The (2, 2) rotation after which most walls, given as points (N, 2) in meters, are parallel to an axis: along both
    axes, their coordinates are the most concentrated."""
    some = places[:: max(1, len(places) // _SAMPLE)].astype(np.float64)
    some = some - some.mean(axis=0)
    best, most = np.eye(2), -1.0
    for heading in _HEADINGS:
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        cells = np.floor(some @ turn.T / (_CELL / 2)).astype(np.int64)
        cells -= cells.min(axis=0)
        score = sum(float((np.bincount(cells[:, axis]).astype(np.float64) ** 2).sum()) for axis in (0, 1))
        if score > most:
            best, most = turn, score
    return best


def _are_walls(counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(rows, columns) bool: cells that have points, of which `counts` (bands, rows, columns) between two heights, and
    which have some between all heights, together with their neighbors."""
    from scipy.ndimage import maximum_filter

    around = maximum_filter(counts, size=(1, 3, 3), mode="constant")
    return np.asarray((around >= _FEW).all(axis=0) & (counts.sum(axis=0) >= _FEW))


def _free_meters(walls: NDArray[np.bool_], axis: int, toward: int) -> NDArray[np.float32]:
    """(rows, columns) float32: free meters from each cell to the next wall along an array `axis`, toward lower (1) or
    higher (-1) indices; infinite without one."""
    count = walls.shape[axis]
    index = np.arange(count).reshape((-1, 1) if axis == 0 else (1, -1))
    if toward > 0:
        last = np.maximum.accumulate(np.where(walls, index, -count * 1000), axis=axis)
        cells = index - last
    else:
        flipped = np.flip(np.where(walls, index, count * 1000), axis)
        cells = np.flip(np.minimum.accumulate(flipped, axis=axis), axis) - index
    return np.where(cells < count, cells * _CELL, np.inf).astype(np.float32)


@dataclass(frozen=True)
class PossibleGlass:
    """Where a glass pane, or a wall without texture, may be. Photographs and depth images do not show them, so the
    corridor through one looks free; but the trajectory goes around it.

    detour    the detours of the trajectory
    openings  the openings of the walls; None if no cloud shows the walls
    seen      the floor that images show; None if they have no depth
    """

    detour: TrajectoryDetour
    openings: WallOpenings | None = None
    seen: SeenFloor | None = None

    def reason(self, a: Camera, b: Camera) -> str:
        """Return a clause, without its subject, why a pane may be on the line between two cameras (x, y, z). "" if none
        may be there.

        A pane may be in an opening of a wall that the trajectory does not pass through, if it passes through a door in
        the same wall, or makes a long detour around the opening. A detour without an opening counts unless images show
        one side of the line from the other."""
        if self.openings is not None and self.openings.leads_through_unused(a, b, beside_door=True):
            return "passes through a wall beside a door, and the trajectory uses only the door"
        meters = self.detour(a, b)
        if not meters or self._is_open(a, b):
            return ""
        return f"skips {f'{meters:.0f} m' if math.isfinite(meters) else 'a long part'} of the trajectory"

    def _is_open(self, a: Camera, b: Camera) -> bool:
        if self.openings is None or self.openings.leads_through_unused(a, b, beside_door=False):
            return False
        return self.seen is not None and self.seen.is_seen_across(a, b)
