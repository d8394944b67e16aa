"""Compiled kernels for the viewing direction and the navigable viewpoints of a batch, in one pass.

Source: the behavior of Matterport3DSimulator, with which the tests compare. It sorts lists of more than 16 locations
with an unstable sort, so the order of locations with exactly equal angles may differ. Here it is the order in the file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry.view_sweep import HEADINGS, STEP

TURN = 2 * math.pi


@njit(cache=True, nogil=True)
def turn(
    heading: NDArray[np.float64],  # (B,) radians, input and output: wrapped to [0, 2 pi)
    elevation: NDArray[np.float64],  # (B,) radians, input and output
    discrete: bool,
    lowest: float,
    highest: float,
    view: NDArray[np.int64],  # (B,) output if discrete: 0 to 35
) -> None:
    """Rounds headings and elevations (B,) to the discrete views, or limits elevations to `lowest` and `highest`."""
    for b in range(len(heading)):
        h = np.fmod(heading[b], TURN)
        while h < 0.0:
            h += TURN
        e = elevation[b]
        if discrete:
            step = int(math.floor(h / (TURN / HEADINGS) + 0.5))
            if step == HEADINGS:
                step = 0
            h = step * (TURN / HEADINGS)
            row = 1
            if e < -STEP / 2:
                row = 0
            elif e > STEP / 2:
                row = 2
            e = (row - 1) * STEP
            view[b] = step + HEADINGS * row
        else:
            e = max(min(e, highest), lowest)
        heading[b], elevation[b] = h, e


@njit(cache=True, nogil=True)
def go(
    chosen: NDArray[np.int64],  # (B,) indices in `where`
    where: NDArray[np.int64],  # (B, K) from `navigable`
    count: NDArray[np.int64],  # (B,)
    place: NDArray[np.int64],  # (B,) output: rows; -1 if `where` has no such column, for a position outside the graph
    heading: NDArray[np.float64],  # (B,) input: turns in radians; output: headings
    elevation: NDArray[np.float64],  # (B,) input: turns in radians; output: elevations
    headings: NDArray[np.float64],  # (B,) radians, before the action
    elevations: NDArray[np.float64],  # (B,) radians, before the action
    discrete: bool,
) -> int:
    """Moves the environments (B,) to the chosen locations and turns them.

    If `discrete` is true, only the sign of a turn counts.

    Returns -1, or the first environment whose choice is not one of its locations; then the outputs are invalid.
    """
    for b in range(len(chosen)):
        if not 0 <= chosen[b] < count[b]:
            return b
        place[b] = where[b, chosen[b]] if chosen[b] < where.shape[1] else -1
        h, e = heading[b], elevation[b]
        if discrete:
            h = STEP if h > 0.0 else (-STEP if h < 0.0 else 0.0)
            e = STEP if e > 0.0 else (-STEP if e < 0.0 else 0.0)
        heading[b], elevation[b] = headings[b] + h, elevations[b] + e
    return -1


@njit(cache=True, nogil=True)
def navigable(
    place: NDArray[np.int64],  # (B,) rows of `starts`
    heading: NDArray[np.float64],  # (B,) radians
    elevation: NDArray[np.float64],  # (B,) radians
    starts: NDArray[np.int64],  # the arrays of a Scan, or of several joined scans
    neighbour: NDArray[np.int64],
    towards: NDArray[np.float32],
    reach: NDArray[np.float64],
    restricted: bool,
    least_cosine: float,  # cosine of the largest angle between a location and the heading
    where: NDArray[np.int64],  # (B, K) output: rows of the locations, sorted by the angle from the image center
    relative: NDArray[np.float64],  # (B, K, 3) output: heading, elevation, distance of each
    count: NDArray[np.int64],  # (B,) output: number of locations
) -> None:
    """Finds the navigable locations (B, K) of the environments. The first location is the current viewpoint."""
    keys = np.empty(where.shape[1])
    for b in range(len(place)):
        here = place[b]
        angle = math.pi / 2 - heading[b]
        cx, cy = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        where[b, 0] = here
        relative[b, 0, :] = 0.0
        keys[0] = 0.0
        n = 1
        for way in range(starts[here], starts[here + 1]):
            x, y = towards[way, 0], towards[way, 1]
            if restricted and not towards[way, 2] * cx + towards[way, 3] * cy >= least_cosine:
                continue
            h = float(math.atan2(x * cy - y * cx, x * cx + y * cy))
            e = reach[way, 1] - elevation[b]
            key = math.sqrt(h * h + e * e)
            at = n
            while at > 0 and keys[at - 1] > key:
                keys[at] = keys[at - 1]
                where[b, at] = where[b, at - 1]
                relative[b, at, :] = relative[b, at - 1, :]
                at -= 1
            keys[at] = key
            where[b, at] = neighbour[way]
            relative[b, at, 0], relative[b, at, 1], relative[b, at, 2] = h, e, reach[way, 0]
            n += 1
        count[b] = n
