"""Tests whether a graph stands on the floor: nothing is below a floor, but much is below a table or a bed. A camera is
carried at an even height above the floor, and through the rooms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud

_CELL = 0.25  # meters: cells of the ground that count once
_REACH = 1.5  # meters around a viewpoint
_UNDER, _DEEPEST = 0.2, 1.6  # meters under the floor of a viewpoint; deeper points are of the storey below
_SHARE = 0.25  # of the cells around a viewpoint with points under its floor; up to 0.05 around floors
_SAMPLE = 1_000_000  # points that are enough for any building
_FEWEST = 12  # cells with points around a viewpoint
_DIRECTIONS = 24  # in which the cameras are measured
_EVEN = 0.35  # of the height of carried cameras: from the lowest tenth to the highest; up to 0.1 over a floor


def share_without_points_below(cloud: Cloud | None, places: NDArray[np.floating]) -> float:
    """The share of floor positions `places` (N, 3), meters, world, that have few points of `cloud` under them.

    1 if there is no cloud or no place. A place with too few points around it counts as a place on the floor.
    """
    if cloud is None or not len(places) or not len(cloud.points):
        return 1.0
    from scipy.spatial import cKDTree

    points = np.asarray(cloud.points[:: max(1, len(cloud.points) // _SAMPLE)], np.float64)
    tree = cKDTree(points[:, :2])
    right = 0
    for place in np.asarray(places, np.float64):
        near = points[tree.query_ball_point(place[:2], _REACH)]
        below = place[2] - near[:, 2]
        near, below = near[below < _DEEPEST], below[below < _DEEPEST]
        cells = np.unique(np.floor(near[:, :2] / _CELL), axis=0)
        under = np.unique(np.floor(near[below > _UNDER, :2] / _CELL), axis=0)
        right += len(cells) < _FEWEST or len(under) < _SHARE * len(cells)
    return right / len(places)


def uneven_height_range(heights: NDArray[np.floating]) -> tuple[float, float] | None:
    """The range, in meters, of the camera `heights` (N,) above the floor if it is too wide for a carried camera, so
    that the floor may be a table. None for usual heights, and for fewer than 8 cameras."""
    if len(heights) < 8:
        return None
    low, middle, high = np.percentile(heights, [10, 50, 90])
    return (float(low), float(high)) if high - low > _EVEN * middle else None


def short_walk(positions: NDArray[np.floating], heights: NDArray[np.floating]) -> float | None:
    """The greatest distance in meters between cameras at `positions` (N, 3), if it is less than their median height
    above the floor, of `heights` (M,). Then the images may show a desk from one place. None for longer distances, and
    without heights."""
    if not len(heights):
        return None
    angles = np.linspace(0, np.pi, _DIRECTIONS, endpoint=False)
    along = np.asarray(positions, np.float64)[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    longest = float(np.ptp(along, axis=0).max())
    return longest if longest < float(np.median(heights)) else None
