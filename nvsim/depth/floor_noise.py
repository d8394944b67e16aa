"""Reduce the noise of the floor in a point cloud from images.

Its points scatter about the floor by centimeters, and points more than 5 cm above the floor count as obstacles. Points
within the scatter are therefore moved toward the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.geometry.floor_surface import Floor

_NEAR = 0.25  # meters from the floor surface within which the scatter is measured
_LEVEL = 0.7  # vertical part of the normal of a point that may be floor
_FEW = 100  # points; with fewer, the scatter cannot be measured
_SIGMAS = 2.5
_LEAST, _MOST = 0.05, 0.15  # meters
_KEPT = 0.1  # share of the scatter that is kept
_BLOCK = 1 << 20  # points whose floor is computed at the same time, 30 MB


def floor_reach(heights: NDArray[np.floating], normals: NDArray[np.floating]) -> float:
    """Height in meters above or below the floor within which a point may be floor.

    It is 2.5 standard deviations of the floor's own points, limited to 0.05 to 0.15.

    heights  (N,) meters above the floor surface, NaN for points to ignore
    normals  (N, 3) unit vectors

    The deviation is the median deviation of points with a vertical normal near the floor, so walls and furniture have
    no influence.
    """
    floor = (np.abs(heights) < _NEAR) & (np.abs(normals[:, 2]) > _LEVEL)
    if np.count_nonzero(floor) < _FEW:
        return _LEAST
    return float(np.clip(_SIGMAS * 1.4826 * np.median(np.abs(heights[floor])), _LEAST, _MOST))


def flatten_floor(cloud: Cloud, surface: Floor) -> Cloud:
    """`cloud` with the floor points from estimated depth moved to `surface`; a tenth of their scatter is kept.

    Points of a LiDAR scan do not move, and neither do points beyond the scatter."""
    if cloud.normals is None:
        return cloud
    ground = np.empty(len(cloud.points), np.float32)
    for start in range(0, len(ground), _BLOCK):
        part = slice(start, start + _BLOCK)
        ground[part] = surface.height_at(cloud.points[part])
    above = np.where(cloud.is_estimated, cloud.points[:, 2] - ground, np.float32(np.nan))
    floor = np.abs(above) <= floor_reach(above, cloud.normals)
    points = cloud.points.copy()
    points[floor, 2] = ground[floor] + np.float32(_KEPT) * above[floor]
    return replace(cloud, points=points)
