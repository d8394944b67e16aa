"""Ray casting in the building. Boxes are in a 2D grid, floors and ceilings are planes, people are capsules."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.building.plan import HEIGHT, Storey
from nvsim.building.solids import Box
from nvsim.kernels import njit

NOTHING = -1
_CELL = 0.5


class Solids(NamedTuple):
    """Boxes in the order of the scene, and for each grid cell (storey by storey, row-major, y first) the boxes in it.

    A hit is identified by its surface: 6 * box + face, then floor and ceiling of each storey, then capsules of people.
    """

    lo: NDArray[np.float64]  # (B, 3) meters
    hi: NDArray[np.float64]  # (B, 3) meters
    glass: NDArray[np.bool_]  # (B,)
    panes: NDArray[np.int64]  # indices of the glass boxes
    start: NDArray[np.int32]  # (storeys * cells + 1,) offsets into `items`
    items: NDArray[np.int32]  # boxes, cell by cell
    origin: NDArray[np.float64]  # (2,) lower corner of the grid, meters
    shape: NDArray[np.int64]  # (2,) rows, columns
    cell: float
    levels: NDArray[np.float64]  # (S, 2) heights of floor and ceiling of every storey, meters
    void: NDArray[np.float64]  # (4,) x0, y0, x1, y1 of the opening between the storeys; zeros if there is one storey


def make_solids(storeys: tuple[Storey, ...], boxes: list[Box]) -> Solids:
    """Builds the arrays for the ray caster."""
    plan = storeys[0].plan
    lo = np.array([b.lo for b in boxes], np.float64)
    hi = np.array([b.hi for b in boxes], np.float64)
    origin = np.array([-_CELL, -_CELL])
    columns = int(np.ceil(plan.extent.x1 / _CELL)) + 2
    rows = int(np.ceil(plan.extent.y1 / _CELL)) + 2
    levels = np.array([(s.floor, s.floor + HEIGHT) for s in storeys])
    cells: list[list[int]] = [[] for _ in range(len(storeys) * rows * columns)]
    first = np.floor((lo[:, :2] - 1e-6 - origin) / _CELL).astype(int)
    last = np.floor((hi[:, :2] + 1e-6 - origin) / _CELL).astype(int)
    lowest, highest = _layer(lo[:, 2] + 1e-6, levels), _layer(hi[:, 2] - 1e-6, levels)
    for b in range(len(boxes)):
        for layer in range(lowest[b], highest[b] + 1):
            for row in range(max(first[b, 1], 0), min(last[b, 1], rows - 1) + 1):
                for column in range(max(first[b, 0], 0), min(last[b, 0], columns - 1) + 1):
                    cells[(layer * rows + row) * columns + column].append(b)
    start = np.concatenate([[0], np.cumsum([len(c) for c in cells])]).astype(np.int32)
    items = np.array([b for c in cells for b in c], np.int32)
    glass = np.array([b.glass for b in boxes])
    void = np.zeros(4) if plan.flight is None else np.array(plan.flight.rect.corners)
    panes = np.flatnonzero(glass)
    return Solids(lo, hi, glass, panes, start, items, origin, np.array([rows, columns]), _CELL, levels, void)


def _layer(heights: NDArray[np.float64], levels: NDArray[np.float64]) -> NDArray[np.int64]:
    """The storey of each height, from its floor to the next floor."""
    return np.maximum(np.searchsorted(levels[:, 0], heights, side="right") - 1, 0)


@njit(cache=True, error_model="numpy")
def trace(ox, oy, oz, dx, dy, dz, solids, people):  # type: ignore[no-untyped-def]
    """The first opaque surface along a ray: (distance, surface, distance of the first glass before it or inf).

    `people` is (P, 5) float64: x, y, lower and upper center height, and radius of vertical capsules. Rays hit a surface
    only from outside, so that a ray can start on one.
    """
    boxes = solids.lo.shape[0]
    storeys = solids.levels.shape[0]
    best, surface, glass = np.inf, NOTHING, np.inf
    if dz < -1e-9:
        best, surface = (solids.levels[0, 0] - oz) / dz, 6 * boxes
        for k in range(1, storeys):
            t = (solids.levels[k, 0] - oz) / dz
            if 0 < t < best and not _in_the_void(ox + t * dx, oy + t * dy, solids):
                best, surface = t, 6 * boxes + 2 * k
    elif dz > 1e-9:
        best, surface = (solids.levels[storeys - 1, 1] - oz) / dz, 6 * boxes + 2 * storeys - 1
        for k in range(storeys - 1):
            t = (solids.levels[k, 1] - oz) / dz
            if 0 < t < best and not _in_the_void(ox + t * dx, oy + t * dy, solids):
                best, surface = t, 6 * boxes + 2 * k + 1
    ix = 1.0 / dx if abs(dx) > 1e-12 else 1e12
    iy = 1.0 / dy if abs(dy) > 1e-12 else 1e12
    iz = 1.0 / dz if abs(dz) > 1e-12 else 1e12
    rows, columns, cell = solids.shape[0], solids.shape[1], solids.cell
    gx, gy = (ox - solids.origin[0]) / cell, (oy - solids.origin[1]) / cell
    column, row = int(np.floor(gx)), int(np.floor(gy))
    step_x, step_y = (1 if ix > 0 else -1), (1 if iy > 0 else -1)
    next_x = ((column + (1 if ix > 0 else 0)) - gx) * cell * ix
    next_y = ((row + (1 if iy > 0 else 0)) - gy) * cell * iy
    delta_x, delta_y = cell * abs(ix), cell * abs(iy)
    entered = 0.0
    while 0 <= row < rows and 0 <= column < columns and entered < best:
        at = oz + entered * dz, oz + min(next_x, next_y, best) * dz
        for layer in range(storeys):
            # Only the storeys that the ray crosses in this column of cells; the tolerance is for rounding.
            if layer > 0 and max(at[0], at[1]) < solids.levels[layer, 0] - 1e-6:
                break
            if layer + 1 < storeys and min(at[0], at[1]) > solids.levels[layer + 1, 0] + 1e-6:
                continue
            here = (layer * rows + row) * columns + column
            for k in range(solids.start[here], solids.start[here + 1]):
                b = solids.items[k]
                axis = 0
                t0, t1 = (solids.lo[b, 0] - ox) * ix, (solids.hi[b, 0] - ox) * ix
                near, far = min(t0, t1), max(t0, t1)
                t0, t1 = (solids.lo[b, 1] - oy) * iy, (solids.hi[b, 1] - oy) * iy
                low = min(t0, t1)
                if low > near:
                    near, axis = low, 1
                far = min(far, max(t0, t1))
                if near > far:
                    continue
                t0, t1 = (solids.lo[b, 2] - oz) * iz, (solids.hi[b, 2] - oz) * iz
                low = min(t0, t1)
                if low > near:
                    near, axis = low, 2
                far = min(far, max(t0, t1))
                if near > far or near < 1e-6:
                    continue
                if solids.glass[b]:
                    glass = min(glass, near)
                elif near < best:
                    best = near
                    if axis == 0:
                        surface = 6 * b + (0 if dx > 0 else 1)
                    elif axis == 1:
                        surface = 6 * b + (2 if dy > 0 else 3)
                    else:
                        surface = 6 * b + (4 if dz > 0 else 5)
        if next_x < next_y:
            entered, column, next_x = next_x, column + step_x, next_x + delta_x
        else:
            entered, row, next_y = next_y, row + step_y, next_y + delta_y
    for p in range(people.shape[0]):
        t = _capsule(ox, oy, oz, dx, dy, dz, people[p, 0], people[p, 1], people[p, 2], people[p, 3], people[p, 4])
        if t < best:
            best, surface = t, 6 * boxes + 2 * storeys + p
    return best, surface, glass if glass < best else np.inf


@njit(cache=True, error_model="numpy")
def _in_the_void(x, y, solids):  # type: ignore[no-untyped-def]
    v = solids.void
    return v[0] < x < v[2] and v[1] < y < v[3]


@njit(cache=True, error_model="numpy")
def _capsule(ox, oy, oz, dx, dy, dz, x, y, z0, z1, r):  # type: ignore[no-untyped-def]
    """Distance to a vertical capsule, inf if the ray misses it or starts inside."""
    px, py = ox - x, oy - y
    a, b, c = dx * dx + dy * dy, px * dx + py * dy, px * px + py * py - r * r
    if c < 0 or a < 1e-12:
        return np.inf
    root = b * b - a * c
    if root < 0:
        return np.inf
    t = (-b - np.sqrt(root)) / a
    z = oz + t * dz
    if t > 0 and z0 <= z <= z1:
        return t
    pz = oz - (z0 if z < z0 else z1)
    b, c = b + pz * dz, px * px + py * py + pz * pz - r * r
    root = b * b - c
    if root < 0:
        return np.inf
    t = -b - np.sqrt(root)
    return t if t > 0 else np.inf


@njit(cache=True, error_model="numpy")
def normal(surface, boxes):  # type: ignore[no-untyped-def]
    """The outward normal of a surface of the building (not of people, because theirs depends on the point)."""
    if surface >= 6 * boxes:
        return 0.0, 0.0, 1.0 if (surface - 6 * boxes) % 2 == 0 else -1.0
    face = surface % 6
    sign = -1.0 if face % 2 == 0 else 1.0
    if face < 2:
        return sign, 0.0, 0.0
    if face < 4:
        return 0.0, sign, 0.0
    return 0.0, 0.0, sign
