"""Cast rays through the voxels of a band over the floor: find the voxels that they hit and pass.

Voxel indices are OctoMap's, floor(coordinate / resolution), and rays are traversed as in Amanatides and Woo 1987.
Column (r, c) stores `layers` voxels upward from `base[r, c]`, so a band over a rising floor uses no more memory than
over a flat floor. A flat array stores the layers of one column after the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit

PASSED, HIT = np.uint8(1), np.uint8(2)
"""Effect of one scan's rays on a voxel; 0 for none."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _voxel(r: int, c: int, level: int, base: NDArray[np.int32], layers: int) -> int:
    """The index of a voxel in the flat array; -1 outside the band."""
    if r < 0 or c < 0 or r >= base.shape[0] or c >= base.shape[1]:
        return -1
    k = level - base[r, c]
    return (r * base.shape[1] + c) * layers + k if 0 <= k < layers else -1


@njit(cache=True, nogil=True, error_model="numpy")
def mark_hits(
    ends: NDArray[np.float64],
    base: NDArray[np.int32],
    layers: int,
    marks: NDArray[np.uint8],
    touched: NDArray[np.int64],
    count: int,
) -> int:
    """Mark the voxels of `ends` (N, 3) as hit, and append voxels without a mark to `touched` from `count` on.

    `ends` is in voxels: x, y from the corner of the grid, z from the world origin. `base` is (rows, columns). `touched`
    must have space for N more entries. Returns the new count."""
    for i in range(len(ends)):
        v = _voxel(int(np.floor(ends[i, 1])), int(np.floor(ends[i, 0])), int(np.floor(ends[i, 2])), base, layers)
        if v < 0:
            continue
        if marks[v] == 0:
            touched[count] = v
            count += 1
        marks[v] = HIT
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def mark_passed(
    start: NDArray[np.float64],
    ends: NDArray[np.float64],
    first: int,
    base: NDArray[np.int32],
    layers: int,
    lowest: int,
    highest: int,
    marks: NDArray[np.uint8],
    touched: NDArray[np.int64],
    count: int,
    stepped: NDArray[np.int64],
) -> tuple[int, int]:
    """Mark every voxel that the rays from `start` (N, 3) to `ends` (N, 3) pass, except the last, if it is not a hit.

    Starts with ray `first`, and stops before a ray for which `touched` may be too short. `lowest` and `highest` are the
    levels between which any column has voxels. Returns the next ray, N when all are done, and the new count. The number
    of steps is added to `stepped` (1,).
    """
    rows, columns = base.shape
    steps = 0
    for i in range(first, len(ends)):
        x, y, z = start[i, 0], start[i, 1], start[i, 2]
        dx, dy, dz = ends[i, 0] - x, ends[i, 1] - y, ends[i, 2] - z
        c, r, level = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        last_c, last_r, last = int(np.floor(ends[i, 0])), int(np.floor(ends[i, 1])), int(np.floor(ends[i, 2]))
        left = abs(last_c - c) + abs(last_r - r) + abs(last - level)
        if count + left > len(touched):
            stepped[0] += steps
            return i, count
        step_c, step_r, step = (1 if dx > 0 else -1), (1 if dy > 0 else -1), (1 if dz > 0 else -1)
        # An axis has no more crossings once it reaches the end voxel, so rounding cannot lead a ray past its end.
        next_c = ((c + (step_c > 0)) - x) / dx if c != last_c else np.inf
        next_r = ((r + (step_r > 0)) - y) / dy if r != last_r else np.inf
        next_z = ((level + (step > 0)) - z) / dz if level != last else np.inf
        size_c, size_r, size_z = 1 / abs(dx), 1 / abs(dy), 1 / abs(dz)
        # A straight line between two voxels of the grid stays inside the grid.
        inside = 0 <= c < columns and 0 <= r < rows and 0 <= last_c < columns and 0 <= last_r < rows
        ground, v = 0, -1
        if inside:
            ground, v = base[r, c], (r * columns + c) * layers
        while left > 0:
            steps += 1
            at = -1
            if inside:
                k = level - ground
                if 0 <= k < layers:
                    at = v + k
            else:
                at = _voxel(r, c, level, base, layers)
            if at >= 0 and marks[at] == 0:
                marks[at] = PASSED
                touched[count] = at
                count += 1
            left -= 1
            if next_z <= next_c and next_z <= next_r:
                level += step
                next_z = next_z + size_z if level != last else np.inf
                if (step > 0 and level >= highest) or (step < 0 and level < lowest):
                    break
                continue
            if next_c < next_r:
                c += step_c
                next_c = next_c + size_c if c != last_c else np.inf
            else:
                r += step_r
                next_r = next_r + size_r if r != last_r else np.inf
            if inside:
                ground, v = base[r, c], (r * columns + c) * layers
    stepped[0] += steps
    return len(ends), count


@njit(cache=True, nogil=True, error_model="numpy")
def update_log_odds(
    marks: NDArray[np.uint8],
    touched: NDArray[np.int64],
    count: int,
    log_odds: NDArray[np.float32],
    odds: NDArray[np.float32],
) -> None:
    """Update `log_odds` (V,) with one scan, once for each voxel in `touched`, and clear its marks. `odds` (4,): of a
    hit, of a pass, and the lower and upper limits."""
    for i in range(count):
        v = touched[i]
        if marks[v] == HIT:
            log_odds[v] = min(log_odds[v] + odds[0], odds[3])
        else:
            log_odds[v] = max(log_odds[v] + odds[1], odds[2])
        marks[v] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def dilate_walls(
    touched: NDArray[np.int64],
    count: int,
    width: int,
    base: NDArray[np.int32],
    layers: int,
    walls: NDArray[np.bool_],
) -> None:
    """Mark in `walls` (V,) all voxels within `width` voxels, along every axis, of the first `count` of `touched`."""
    rows, columns = base.shape
    for i in range(count):
        column, k = touched[i] // layers, touched[i] % layers
        r, c = column // columns, column % columns
        level = base[r, c] + k
        for to_r in range(max(r - width, 0), min(r + width + 1, rows)):
            for to_c in range(max(c - width, 0), min(c + width + 1, columns)):
                first = level - width - base[to_r, to_c]
                start = (to_r * columns + to_c) * layers
                for to_k in range(max(first, 0), min(first + 2 * width + 1, layers)):
                    walls[start + to_k] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _is_open(
    x: float,
    y: float,
    z: float,
    end: NDArray[np.float64],
    base: NDArray[np.int32],
    layers: int,
    walls: NDArray[np.bool_],
    close: int,
) -> bool:
    """Whether no voxel of `walls` is between a place and `end` (3,), except within `close` voxels of the end."""
    dx, dy, dz = end[0] - x, end[1] - y, end[2] - z
    c, r, level = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    last_c, last_r, last = int(np.floor(end[0])), int(np.floor(end[1])), int(np.floor(end[2]))
    step_c, step_r, step = (1 if dx > 0 else -1), (1 if dy > 0 else -1), (1 if dz > 0 else -1)
    next_c = ((c + (step_c > 0)) - x) / dx if c != last_c else np.inf
    next_r = ((r + (step_r > 0)) - y) / dy if r != last_r else np.inf
    next_z = ((level + (step > 0)) - z) / dz if level != last else np.inf
    size_c, size_r, size_z = 1 / abs(dx), 1 / abs(dy), 1 / abs(dz)
    for _ in range(abs(last_c - c) + abs(last_r - r) + abs(last - level)):
        if max(abs(last_c - c), abs(last_r - r), abs(last - level)) <= close:
            return True
        v = _voxel(r, c, level, base, layers)
        if v >= 0 and walls[v]:
            return False
        if next_z <= next_c and next_z <= next_r:
            level += step
            next_z = next_z + size_z if level != last else np.inf
        elif next_c < next_r:
            c += step_c
            next_c = next_c + size_c if c != last_c else np.inf
        else:
            r += step_r
            next_r = next_r + size_r if r != last_r else np.inf
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def find_first_visible(
    places: NDArray[np.float64],
    order: NDArray[np.int64],
    ends: NDArray[np.float64],
    base: NDArray[np.int32],
    layers: int,
    walls: NDArray[np.bool_],
    close: int,
    out: NDArray[np.int64],
) -> None:
    """Fill `out` (N, L) with the first L rows of `places` (M, 3) that see each of `ends` (N, 3) past `walls`.

    `order` (N, K) lists the rows to test; entries of M or more are ignored. Walls within `close` voxels of the end are
    ignored. Unused entries of `out` are -1."""
    out[:] = -1
    for i in range(len(ends)):
        found = 0
        for j in order[i]:
            if j >= len(places) or found == out.shape[1]:
                break
            if _is_open(places[j, 0], places[j, 1], places[j, 2], ends[i], base, layers, walls, close):
                out[i, found] = j
                found += 1


@njit(cache=True, nogil=True, error_model="numpy")
def project_down(
    log_odds: NDArray[np.float32],
    layers: int,
    band: int,
    foot: int,
    hit: NDArray[np.bool_],
    open_below: NDArray[np.bool_],
) -> None:
    """Fill `hit` and `open_below` (rows, columns) bool from `log_odds` (V,).

    `hit`: one of the lowest `band` voxels of the column is occupied. `open_below`: none of the lowest `foot` voxels is
    occupied, and one is free."""
    rows, columns = hit.shape
    for r in range(rows):
        for c in range(columns):
            start = (r * columns + c) * layers
            passed, stands, above = False, False, False
            for k in range(band):
                value = log_odds[start + k]
                if value > 0:
                    above = True
                    stands |= k < foot
                elif value < 0 and k < foot:
                    passed = True
            hit[r, c] = above
            open_below[r, c] = passed and not stands
