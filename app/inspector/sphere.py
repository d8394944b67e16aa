"""Projects floor regions to a panorama, and finds the region in a viewing direction. Does not use Qt."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.state.directions import Direction

_FINE = 14  # points per side of a region, because straight lines on the floor are curves in a panorama


def angles(points: NDArray[np.float64], eye: NDArray[np.float64], around: float = 0.0) -> NDArray[np.float64]:
    """(N, 2) heading and elevation in radians of world points (N, 3), seen from `eye` (3,); meters. The headings are
    within half a turn of `around`."""
    way = points - eye
    heading = np.arctan2(way[:, 0], way[:, 1])
    heading = (heading - around + math.pi) % (2 * math.pi) - math.pi + around
    return np.stack([heading, np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))], axis=1)


def fine(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) points of the closed outline with the corners (N, 3), with added points on each side."""
    share = np.linspace(0, 1, _FINE, endpoint=False)[:, None]
    following = np.roll(corners, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, following, strict=True)])


def met(found: Sequence[Direction], eye: NDArray[np.float64], heading: float, elevation: float) -> Direction | None:
    """The direction whose floor region the ray from `eye` (3,) at `heading` and `elevation` (radians) hits.

    If it hits several regions, the one whose center line is nearest; None if it hits none."""
    if elevation >= -1e-3:
        return None
    best, least = None, math.inf
    for direction in found:
        e = direction.evidence
        distance = float(eye[2] - direction.floor[0]) / math.tan(-elevation)
        turn = heading - e.heading
        along, across = distance * math.cos(turn), abs(distance * math.sin(turn))
        rows, cells = direction.explanation.corridor
        half = max(abs(cells.start - e.alpha.shape[1] / 2), abs(cells.stop - e.alpha.shape[1] / 2))
        inside = 0 <= along <= e.near + rows.stop * e.depth and across <= half * e.width / e.alpha.shape[1]
        # A step takes precedence over an edge corridor that covers it.
        if inside and across + 0.02 * (not direction.lattice) < least:
            best, least = direction, across + 0.02 * (not direction.lattice)
    return best
