"""The floor in the cloud that images gave: its points scatter about the floor by centimetres, and what stands higher
than five is taken for an obstacle. So what lies within the scatter is drawn to the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.geometry.stacked_floor import Floor

_NEAR = 0.25  # metres from the floor surface within which the scatter is measured
_LEVEL = 0.7  # vertical part of the normal of a point that may be floor
_FEW = 100  # points; of fewer the scatter cannot be told
_SIGMAS = 2.5
_LEAST, _MOST = 0.05, 0.15  # metres
_KEPT = 0.1  # share of the scatter that is left


def floor_reach(heights: NDArray[np.floating], normals: NDArray[np.floating]) -> float:
    """Metres from the floor within which a point may be floor: 2.5 standard deviations of the floor's own points, 0.05
    to 0.15.

    heights  (N,) metres above the floor surface
    normals  (N, 3) unit

    The deviation is the median one of what lies level near the floor, so that walls and furniture do not count.
    """
    floor = (np.abs(heights) < _NEAR) & (np.abs(normals[:, 2]) > _LEVEL)
    if np.count_nonzero(floor) < _FEW:
        return _LEAST
    return float(np.clip(_SIGMAS * 1.4826 * np.median(np.abs(heights[floor])), _LEAST, _MOST))


def calmed(cloud: Cloud, surface: Floor) -> Cloud:
    """`cloud` with what images gave of the floor drawn to `surface`: a tenth of its scatter is left. Points of a scan
    stay where they are, as do points that no scatter explains."""
    if cloud.normals is None:
        return cloud
    guessed = np.flatnonzero(cloud.is_guessed)
    ground = surface.height_at(cloud.points[guessed])
    above = cloud.points[guessed, 2] - ground
    floor = np.abs(above) <= floor_reach(above, cloud.normals[guessed])
    points = cloud.points.copy()
    points[guessed[floor], 2] = ground[floor] + np.float32(_KEPT) * above[floor]
    return replace(cloud, points=points)
