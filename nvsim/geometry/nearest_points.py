"""Distances between the points of a point cloud, and the principal axes of a neighborhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernel_threads import allowed_threads

_CUBE = 1.0  # meters: side of the cubes with which the density of the cloud is measured
_SIDE = 2.5  # side of the cells in which neighbors are searched, in distances between points
_WIDER = 4.0  # factor by which the cells grow if neighbors are missing


def distance_to(points: NDArray[np.float32], neighbor: int) -> NDArray[np.float32]:
    """(N,) float32 meters from each of the `points` (N, 3) to its `neighbor`-th nearest point, or to the farthest
    point of a tiny cloud.

    The result equals that of a k-d tree. The cell search takes a tenth of the time for half a million points."""
    from concurrent.futures import ThreadPoolExecutor

    from nvsim.geometry import nearest_kernels

    count = min(neighbor + 1, len(points))  # the nearest point to a point is itself
    found = np.full(len(points), np.nan, np.float32)
    if not len(points):
        return found
    places = np.ascontiguousarray(points, np.float64)
    low, high = places.min(axis=0), places.max(axis=0)
    cubes, each = np.unique(_numbers(places, low, high, _CUBE)[0], return_inverse=True)
    dense = float(np.median(np.bincount(each.reshape(-1), minlength=len(cubes))[each.reshape(-1)]))
    side = _SIDE * _CUBE / np.sqrt(dense)
    with ThreadPoolExecutor(allowed_threads(), "nearest") as pool:
        while True:
            number, columns, rows = _numbers(places, low, high, side)
            order = np.argsort(number, kind="stable")
            cells, first = np.unique(number[order], return_index=True)
            first = np.append(first, len(places))
            whole = bool(((high - low) <= side).all())
            given = places[order], cells, first, columns, rows, count, side, whole
            apart = found[order]
            parts = np.linspace(0, len(cells), allowed_threads() + 1).astype(np.int64)
            jobs = [
                pool.submit(nearest_kernels.nearest, *given, int(a), int(b), apart)
                for a, b in zip(parts[:-1], parts[1:], strict=True)
            ]
            for job in jobs:
                job.result()
            found[order] = apart
            if whole or not np.isnan(found).any():
                return found
            side *= _WIDER


def _numbers(
    places: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], side: float
) -> tuple[NDArray[np.int64], int, int]:
    """(N,) cell number of each place (N, 3), and the differences between the numbers of neighboring cells along y and
    z. There is an empty cell on every side."""
    sides = np.floor((high - low) / side).astype(np.int64) + 3
    x, y, z = (np.floor((places - low) / side).astype(np.int64) + 1).T
    return (z * sides[1] + y) * sides[0] + x, int(sides[0]), int(sides[0] * sides[1])


def axes_of(around: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 3, 3) float64 unit axes, in columns, of N neighborhoods of points (N, K, 3).

    The points spread least along the first axis, which is the surface normal if they are on a surface. Signs are
    arbitrary."""
    centered = around.astype(np.float64)
    centered -= centered.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", centered, centered))[1])
