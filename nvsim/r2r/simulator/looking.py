"""Where a camera looks and which viewpoints it may go to from there: one pass over a batch, compiled.

Source: what Matterport3DSimulator does, held against it in the tests. Its lists of more than 16 ways are sorted by an
unstable sort, so that ways of exactly the same angle may come in another order there; here they come in the file's.
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
    heading: NDArray[np.float64],  # (B,) radians, in and out: brought to [0, 2 pi)
    elevation: NDArray[np.float64],  # (B,) radians, in and out
    discrete: bool,
    lowest: float,
    highest: float,
    view: NDArray[np.int64],  # (B,) out where discrete: 0 to 35
) -> None:
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
    chosen: NDArray[np.int64],  # (B,) positions in `where`
    where: NDArray[np.int64],  # (B, K) as `navigable` gives them
    count: NDArray[np.int64],  # (B,)
    place: NDArray[np.int64],  # (B,) out: rows
    heading: NDArray[np.float64],  # (B,) in: turns in radians; out: headings
    elevation: NDArray[np.float64],  # (B,) the same
    headings: NDArray[np.float64],  # (B,) radians, before
    elevations: NDArray[np.float64],  # (B,) radians, before
    discrete: bool,
) -> int:
    """Goes to the chosen locations and turns, by the sign of a turn alone where angles are discrete. Returns -1, or the
    first environment whose choice is none of its locations, and nothing is of use then."""
    for b in range(len(chosen)):
        if not 0 <= chosen[b] < count[b]:
            return b
        place[b] = where[b, chosen[b]]
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
    starts: NDArray[np.int64],  # as those of a Scan, of many joined
    neighbour: NDArray[np.int64],
    towards: NDArray[np.float32],
    reach: NDArray[np.float64],
    restricted: bool,
    least_cosine: float,  # of the angle that a way may be off the heading
    where: NDArray[np.int64],  # (B, K) out: rows that the locations are, the nearest to the image's centre first
    relative: NDArray[np.float64],  # (B, K, 3) out: heading, elevation, distance of each
    count: NDArray[np.int64],  # (B,) out
) -> None:
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
