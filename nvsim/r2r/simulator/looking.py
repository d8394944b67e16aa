"""Viewing directions and navigable viewpoints of a batch.

Source: the behavior of Matterport3DSimulator, with which the tests compare. It sorts lists of more than 16 locations
with an unstable sort, so the order of locations with exactly equal angles may differ. Here it is the order in the file.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.directions import HEADINGS, STEP

TURN = 2 * math.pi


def turn(
    headings: list[float], elevations: list[float], discrete: bool, lowest: float, highest: float, views: list[int]
) -> tuple[list[float], list[float], list[int]]:
    """Rounds headings and elevations, radians, to the discrete views, or limits elevations to `lowest` and `highest`.

    Returns headings in [0, 2 pi), elevations, and views: 0 to 35 if `discrete` is true, else `views`.
    """
    headings = [h % TURN for h in headings]
    if not discrete:
        return headings, [max(min(e, highest), lowest) for e in elevations], views
    steps = [int(h / (TURN / HEADINGS) + 0.5) % HEADINGS for h in headings]
    rows = [0 if e < -STEP / 2 else 2 if e > STEP / 2 else 1 for e in elevations]
    views = [step + HEADINGS * row for step, row in zip(steps, rows)]
    return [step * (TURN / HEADINGS) for step in steps], [(row - 1) * STEP for row in rows], views


def navigable(
    place: NDArray[np.int64],  # (B,) rows of `starts`
    heading: NDArray[np.float64],  # (B,) radians
    elevation: NDArray[np.float64],  # (B,) radians
    starts: NDArray[np.int64],  # the arrays of a Scan, or of several joined scans
    neighbour: NDArray[np.int64],
    towards: NDArray[np.float32],
    reach: NDArray[np.float64],
    least_cosine: float | None,  # cosine of the largest angle between a location and the heading; None for any angle
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Finds the navigable locations of the environments (B,), without the current ones.

    Returns rows (B, K) sorted by the angle from the image center, their heading, elevation, and distance (B, K, 3), and
    the number of valid columns (B,).
    """
    first, end = starts[place], starts[place + 1]
    column = np.arange((end - first).max(initial=0))
    exists = column < (end - first)[:, None]
    way = np.where(exists, first[:, None] + column, 0)
    flat = towards[way]
    x, y, east, north = flat[..., 0], flat[..., 1], flat[..., 2], flat[..., 3]
    angle = (math.pi / 2 - heading)[:, None]
    cx, cy = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
    if least_cosine is not None:
        exists = exists & ((east * cx + north * cy).astype(np.float64) >= least_cosine)
    relative = np.empty((*way.shape, 3))
    relative[..., 2], up = reach[way, 0], reach[way, 1]
    relative[..., 0] = h = np.arctan2(x * cy - y * cx, x * cx + y * cy).astype(np.float64)
    relative[..., 1] = e = up - elevation[:, None]
    order = np.argsort(np.where(exists, np.sqrt(h * h + e * e), np.inf), axis=1, kind="stable")
    each = np.arange(len(place))[:, None]
    return neighbour[way[each, order]], relative[each, order], exists.sum(axis=1)
