"""Where a disc fits, moves, and sees on an occupancy map. Unknown cells block movement and sight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit
from nvsim.occupancy.types import FREE, OccupancyMap

FloatArray = NDArray[np.floating]


def clearance(occupancy: OccupancyMap) -> NDArray[np.float64]:
    """(rows, columns) float64 meters from the center of every free cell to the nearest edge of a cell that is not free,
    measured to that cell's center minus half a cell.

    Cells outside the map are not free. The value is 0 at cells that are not free."""
    from scipy.ndimage import distance_transform_edt

    free = np.pad(occupancy.cells == FREE, 1)
    distance = distance_transform_edt(free)[1:-1, 1:-1]
    return np.asarray(np.maximum(distance - 0.5, 0.0) * occupancy.resolution)


def standing_room(occupancy: OccupancyMap, radius: float = 0.0) -> NDArray[np.bool_]:
    """(rows, columns) bool, True for cells at whose center a disc of `radius` meters touches only free cells."""
    if radius <= 0:
        return occupancy.cells == FREE
    return clearance(occupancy) >= radius


def points_are_free(room: NDArray[np.bool_], occupancy: OccupancyMap, xy: FloatArray) -> NDArray[np.bool_]:
    """(N,) bool, True if the cells of world points `xy` (N, 2), meters, are True in `room`; False outside the map."""
    index = occupancy.index(np.asarray(xy, np.float64).reshape(-1, 2))
    rows, columns = room.shape
    inside = (index >= 0).all(axis=1) & (index[:, 0] < rows) & (index[:, 1] < columns)
    found = np.zeros(len(index), bool)
    found[inside] = room[index[inside, 0], index[inside, 1]]
    return found


def segments_are_free(
    room: NDArray[np.bool_], occupancy: OccupancyMap, a: FloatArray, b: FloatArray
) -> NDArray[np.bool_]:
    """(N,) bool, True if all cells on the segment from `a` (N, 2) to `b` (N, 2), world meters, are True in `room`."""
    starts, ends = _grid(occupancy, a), _grid(occupancy, b)
    out = np.empty(len(starts), np.bool_)
    _walk_all(np.ascontiguousarray(room), starts, ends, out)
    return out


def segment_is_free(occupancy: OccupancyMap, a: FloatArray, b: FloatArray, radius: float = 0.0) -> bool:
    """Whether a disc of `radius` meters can move straight from `a` (2,) to `b` (2,), world meters."""
    return bool(segments_are_free(standing_room(occupancy, radius), occupancy, np.array([a]), np.array([b]))[0])


def reachable(occupancy: OccupancyMap, seeds: FloatArray, radius: float = 0.0) -> NDArray[np.bool_]:
    """(rows, columns) bool, True for cells that a disc of `radius` meters reaches from any of the world points `seeds`
    (N, 2), meters, by steps to the four neighbors. Seeds where the disc does not fit are ignored."""
    from scipy.ndimage import label

    room = standing_room(occupancy, radius)
    parts, count = label(room)
    index = occupancy.index(np.asarray(seeds, np.float64).reshape(-1, 2))
    rows, columns = room.shape
    index = index[(index >= 0).all(axis=1) & (index[:, 0] < rows) & (index[:, 1] < columns)]
    wanted = np.zeros(count + 1, bool)
    wanted[parts[index[:, 0], index[:, 1]]] = True
    wanted[0] = False
    return np.asarray(wanted[parts])


def visible(occupancy: OccupancyMap, viewpoints: FloatArray, reach: float) -> NDArray[np.bool_]:
    """(rows, columns) bool, True for free cells that are visible from one of the world points `viewpoints`.

    `viewpoints` is (2,) or (N, 2), meters. A cell is visible if its center is within `reach` meters and the straight
    line to it crosses only free cells."""
    starts = _grid(occupancy, np.atleast_2d(np.asarray(viewpoints, np.float64)))
    out = np.zeros(occupancy.cells.shape, np.bool_)
    _see_all(np.ascontiguousarray(occupancy.cells == FREE), starts, reach / occupancy.resolution, out)
    return out


def _grid(occupancy: OccupancyMap, xy: FloatArray) -> NDArray[np.float64]:
    """(N, 2) row and column as real numbers; cell [r, c] spans [r, r + 1) x [c, c + 1)."""
    xy = np.asarray(xy, np.float64).reshape(-1, 2)
    return np.ascontiguousarray((xy - np.array(occupancy.origin))[:, ::-1] / occupancy.resolution)


@njit(cache=True)
def _is_free(room: NDArray[np.bool_], r: int, c: int) -> bool:
    return r >= 0 and c >= 0 and r < room.shape[0] and c < room.shape[1] and bool(room[r, c])


@njit(cache=True)
def _is_segment_free(
    room: NDArray[np.bool_],  # (rows, columns)
    r0: float,  # start of the segment, in the coordinates of `_grid`
    c0: float,
    r1: float,  # end of the segment
    c1: float,
) -> bool:
    """Traverse the cells along the segment (Amanatides and Woo 1987). Through an exact corner it may pass beside one
    blocked cell, but not between two."""
    r, c = int(np.floor(r0)), int(np.floor(c0))
    last_r, last_c = int(np.floor(r1)), int(np.floor(c1))
    if not _is_free(room, r, c):
        return False
    dr, dc = r1 - r0, c1 - c0
    step_r = 1 if dr > 0 else -1
    step_c = 1 if dc > 0 else -1
    next_r = ((r + (step_r > 0)) - r0) / dr if dr != 0 else np.inf
    next_c = ((c + (step_c > 0)) - c0) / dc if dc != 0 else np.inf
    size_r = 1 / abs(dr) if dr != 0 else np.inf
    size_c = 1 / abs(dc) if dc != 0 else np.inf
    left = abs(last_r - r) + abs(last_c - c)
    while left > 0:
        if abs(next_r - next_c) < 1e-9 and left > 1:
            if not _is_free(room, r + step_r, c) and not _is_free(room, r, c + step_c):
                return False
            r, c = r + step_r, c + step_c
            next_r, next_c = next_r + size_r, next_c + size_c
            left -= 2
        elif next_r < next_c:
            r, next_r, left = r + step_r, next_r + size_r, left - 1
        else:
            c, next_c, left = c + step_c, next_c + size_c, left - 1
        if not _is_free(room, r, c):
            return False
    return True


@njit(cache=True)
def _walk_all(
    room: NDArray[np.bool_],  # (rows, columns)
    starts: NDArray[np.float64],  # (N, 2) `_grid`
    ends: NDArray[np.float64],  # (N, 2) `_grid`
    out: NDArray[np.bool_],  # (N,)
) -> None:
    for i in range(len(starts)):
        out[i] = _is_segment_free(room, starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1])


@njit(cache=True)
def _see_all(
    free: NDArray[np.bool_],  # (rows, columns)
    starts: NDArray[np.float64],  # (N, 2) `_grid`
    reach: float,  # cells
    out: NDArray[np.bool_],  # (rows, columns) updated: cells visible from a start become True
) -> None:
    for i in range(len(starts)):
        r0, c0 = starts[i, 0], starts[i, 1]
        for r in range(max(0, int(r0 - reach)), min(free.shape[0], int(r0 + reach) + 2)):
            for c in range(max(0, int(c0 - reach)), min(free.shape[1], int(c0 + reach) + 2)):
                if out[r, c] or not free[r, c]:
                    continue
                if (r + 0.5 - r0) ** 2 + (c + 0.5 - c0) ** 2 <= reach * reach + 1e-9:
                    out[r, c] = _is_segment_free(free, r0, c0, r + 0.5, c + 0.5)
