"""The dominant floor plane of a cloud: the direction near "up" and the height below the cameras at which points pile up.

One plane for the whole capture is enough to say where up is and how high the cameras are; heights of the floor itself
are local and are estimated elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 20_000  # points that the search looks at
_LEAST_POINTS = 30
_LEAST_SHARE = 0.03  # of the points below the cameras


@dataclass(frozen=True, eq=False)
class FloorPlane:
    """Points p on it have normal . p = offset; `normal` (3,) is a unit vector towards the cameras, `share` the part of
    the cloud below the cameras that lies on it."""

    normal: NDArray[np.float64]
    offset: float
    share: float

    def height_of(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Heights (N,) of positions (N, 3) above the plane, in their unit."""
        return np.asarray(positions @ self.normal - self.offset, np.float64)


def find_floor(
    points: NDArray[np.floating], positions: NDArray[np.float64], up: NDArray[np.float64], cone_degrees: float = 20.0
) -> FloorPlane | None:
    """The floor among `points` (N, 3) below the camera `positions` (M, 3), its normal within `cone_degrees` of the unit
    vector `up` (3,); None where nothing piles up. Works in any unit: the layer's thickness is 1 % of the median distance
    from a point to the nearest camera. Deterministic.

    Directions are searched from coarse to fine; for each, points are counted in layers along it. The floor is the lowest
    layer that is at least half as full as the fullest, because a desk may outshine a floor but nothing lies below one.
    """
    from scipy.spatial import cKDTree

    sample = np.asarray(points[:: max(1, len(points) // _SAMPLE)], np.float64)
    if len(sample) < _LEAST_POINTS or not len(positions):
        return None
    origin = np.median(positions, axis=0)
    sample = sample - origin
    distances, _ = cKDTree(positions - origin).query(sample)
    reach = float(np.median(distances))
    near = sample[distances <= 4 * reach]  # a view through a window is no floor
    thickness = 0.01 * reach
    if thickness <= 0:
        return None
    normal, low = up / np.linalg.norm(up), 0.0
    for spread, step, layer in ((cone_degrees, 4.0, 4.0), (4.0, 1.0, 2.0), (1.0, 0.25, 1.0)):
        found = _best_layer(near, _directions(normal, spread, step), layer * thickness)
        if found is None:
            return None
        normal, low = found
    for _ in range(4):
        on_plane = np.abs(near @ normal - low) < 1.5 * thickness
        if np.count_nonzero(on_plane) < _LEAST_POINTS:
            return None
        centre = near[on_plane].mean(axis=0)
        axes = np.linalg.svd(near[on_plane] - centre, full_matrices=False)[2]
        if axes[2] @ up < 0:
            axes = -axes
        normal, low = axes[2], float(centre @ axes[2])
    on_plane = np.abs(near @ normal - low) < 1.5 * thickness
    share = np.count_nonzero(on_plane) / max(1, np.count_nonzero(near @ normal < 0))
    if normal @ up < np.cos(np.radians(cone_degrees + 6)) or share < _LEAST_SHARE or low >= 0:
        return None
    return FloorPlane(normal, float(low + origin @ normal), float(share))


def _directions(axis: NDArray[np.float64], spread: float, step: float) -> NDArray[np.float64]:
    """(K, 3) unit vectors within `spread` degrees of `axis`, about `step` degrees apart."""
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    ticks = np.tan(np.radians(np.arange(-spread, spread + step / 2, step)))
    a, b = (g.ravel() for g in np.meshgrid(ticks, ticks))
    inside = np.hypot(a, b) <= np.tan(np.radians(spread)) + 1e-9
    found = axis + a[inside, None] * side + b[inside, None] * other
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _best_layer(
    points: NDArray[np.float64], directions: NDArray[np.float64], thickness: float
) -> tuple[NDArray[np.float64], float] | None:
    """The direction whose fullest layer below the origin is fullest, and the height of its lowest full layer."""
    best, best_count, best_height = None, 0, 0.0
    for direction in directions:
        heights = points @ direction
        heights = heights[(heights < 0) & (heights > -10_000 * thickness)]
        if not len(heights):
            continue
        counts = np.bincount((-heights / thickness).astype(np.int64))
        pairs = counts[:-1] + counts[1:] if len(counts) > 1 else counts  # a floor may straddle two layers
        if pairs.max() > best_count:
            layer = int(np.flatnonzero(pairs >= 0.5 * pairs.max())[-1])
            best, best_count = direction, int(pairs.max())
            best_height = -(layer + 1) * thickness
    return None if best is None else (best, best_height)
