"""Numba kernels of `raised_lines`: whether another image shows a line at an assumed height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

_SLANT = 0.07  # sine of the greatest angle between a segment and the line that it shows
_COVERED = 0.5  # share of a line that segments must cover
_LEAST = 8.0  # pixels of a line in view; a shorter one is not tested
_IN_VIEW = 0.3  # share of a line that must be in view
_NEAREST = 0.3  # meters before the camera
_BORDER = 2.0  # pixels


@njit(cache=True, nogil=True)
def is_shown(ax: float, ay: float, bx: float, by: float, segments: Float64, tolerance: float) -> bool:
    """Whether `segments` (n, 4), x0 y0 x1 y1 pixels, cover enough of the line from a to b, at most `tolerance` pixels
    from it."""
    length = np.hypot(bx - ax, by - ay)
    if length < _LEAST:
        return False
    ux, uy, covered = (bx - ax) / length, (by - ay) / length, 0.0
    for s in range(len(segments)):
        x0, y0, x1, y1 = segments[s]
        if abs(ux * (y1 - y0) - uy * (x1 - x0)) > _SLANT * np.hypot(x1 - x0, y1 - y0):
            continue
        along0, along1 = (x0 - ax) * ux + (y0 - ay) * uy, (x1 - ax) * ux + (y1 - ay) * uy
        beside0, beside1 = (y0 - ay) * ux - (x0 - ax) * uy, (y1 - ay) * ux - (x1 - ax) * uy
        if along0 > along1:
            along0, along1, beside0, beside1 = along1, along0, beside1, beside0
        low, high = max(along0, 0.0), min(along1, length)
        if high <= low:
            continue
        slope = (beside1 - beside0) / max(along1 - along0, 1e-6)
        at_low, at_high = beside0 + slope * (low - along0), beside0 + slope * (high - along0)
        if abs(at_low) <= tolerance and abs(at_high) <= tolerance:
            covered += high - low
    return covered >= _COVERED * length


@njit(cache=True, nogil=True)
def _in_view(p: Float64, q: Float64, pose: Float64, lens: Float64, line: Float64) -> bool:
    """Writes the part in view of the line from p (3,) to q (3,), meters, world, to `line` (4,), x0 y0 x1 y1 pixels.
    False if too little of it is in view."""
    for end in range(2):
        x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
        for k in range(3):
            at = p[k] if end == 0 else q[k]
            x, y, z = x + pose[0, k] * at, y + pose[1, k] * at, z + pose[2, k] * at
        if z < _NEAREST:
            return False
        line[2 * end], line[2 * end + 1] = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
    dx, dy, first, last = line[2] - line[0], line[3] - line[1], 0.0, 1.0
    for side in range(4):
        step = (-dx, dx, -dy, dy)[side]
        room = (line[0] - _BORDER, lens[4] - _BORDER - line[0], line[1] - _BORDER, lens[5] - _BORDER - line[1])[side]
        if step == 0:
            if room < 0:
                return False
        elif step < 0:
            first = max(first, room / step)
        else:
            last = min(last, room / step)
    if last - first < _IN_VIEW:
        return False
    x, y = line[0], line[1]
    line[0], line[1], line[2], line[3] = x + first * dx, y + first * dy, x + last * dx, y + last * dy
    return True


@njit(cache=True, nogil=True)
def count_line_votes(
    starts: Float64,  # (n, heights, 3) meters, world: starts of the lines at each height, the first on the floor
    ends: Float64,  # (n, heights, 3) meters, world: their ends
    pose: Float64,  # (4, 4) world to camera
    lens: Float64,  # (6,) fx, fy, cx, cy, width, height, pixels
    segments: Float64,  # (m, 4) of the tested image, pixels
    tolerance: float,  # pixels
    parallax: float,  # pixels
    asked: Int64,  # (n, heights) incremented if `parallax` suffices to tell this height from the floor in the image
    shown: Int64,  # (n, heights) incremented if the image then also shows the line at this height
    on_floor: Int64,  # (n, heights) incremented if the image then also shows the line on the floor
) -> None:
    """Counts for every line and height whether one image can decide, confirms the height, or shows it on the floor."""
    low, high = np.empty(4), np.empty(4)
    for i in range(len(starts)):
        if not _in_view(starts[i, 0], ends[i, 0], pose, lens, low):
            continue
        length = np.hypot(low[2] - low[0], low[3] - low[1])
        if length < 1e-9:
            continue
        ux, uy = (low[2] - low[0]) / length, (low[3] - low[1]) / length
        flat = is_shown(low[0], low[1], low[2], low[3], segments, tolerance)
        for k in range(1, starts.shape[1]):
            if not _in_view(starts[i, k], ends[i, k], pose, lens, high):
                continue
            middle_x, middle_y = (high[0] + high[2]) / 2 - low[0], (high[1] + high[3]) / 2 - low[1]
            if abs(middle_y * ux - middle_x * uy) < parallax:
                continue
            asked[i, k] += 1
            shown[i, k] += is_shown(high[0], high[1], high[2], high[3], segments, tolerance)
            on_floor[i, k] += flat
