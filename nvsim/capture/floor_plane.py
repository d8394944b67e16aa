"""Find the dominant floor plane of a point cloud: a direction near up and a height below the cameras with many points.

One plane for the whole capture is enough to find the up direction and the camera height. Local floor heights are
estimated elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 20_000  # points that are searched
_LEAST_POINTS = 30
_LEAST_SHARE = 0.02  # of the points below the cameras
_CONTRAST = 1.5  # minimum ratio of points in the floor to points in equal layers above it; the foot of a wall has less


@dataclass(frozen=True, eq=False)
class FloorPlane:
    """A plane of the points p with normal . p = offset, in the unit of the source.

    `normal` (3,) is a unit vector that points to the cameras. `share` is the fraction of the points below the cameras
    that are on the plane."""

    normal: NDArray[np.float64]
    offset: float
    share: float

    def height_of(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N,) float64 heights of `positions` (N, 3) above the plane, in their unit."""
        return np.asarray(positions @ self.normal - self.offset, np.float64)


def find_floor(
    points: NDArray[np.floating], positions: NDArray[np.float64], up: NDArray[np.float64], cone_degrees: float = 20.0
) -> FloorPlane | None:
    """The floor among `points` (N, 3) below the camera `positions` (M, 3), or None if no layer has enough points.

    Its normal is within `cone_degrees` of the unit vector `up` (3,). The function works in any unit: the thickness of
    a layer is 1 % of the median distance from a point to the nearest camera. Deterministic.

    Directions are searched from coarse to fine. For each direction, points are counted in layers along it. The score
    of a layer is its number of points minus the number of points below it. A desk may have more points than the floor,
    but there are no points below the floor.
    """
    from scipy.spatial import cKDTree

    sample = np.asarray(points[:: max(1, len(points) // _SAMPLE)], np.float64)
    if len(sample) < _LEAST_POINTS or not len(positions):
        return None
    origin = np.median(positions, axis=0)
    sample = sample - origin
    distances, _ = cKDTree(positions - origin).query(sample)
    reach = float(np.median(distances))
    near = sample[distances <= 4 * reach]  # excludes views through a window
    thickness = 0.01 * reach
    if thickness <= 0:
        return None
    normal, low = up / np.linalg.norm(up), 0.0
    for spread, layer in ((cone_degrees, 4.0), (cone_degrees / 4, 2.0), (cone_degrees / 12, 1.0)):
        found = _best_layer(near, _directions(normal, spread, spread / 5), layer * thickness)
        if found is None:
            return None
        normal, low = found
    searched = normal
    on_plane = np.abs(near @ normal - low) < 1.5 * thickness
    for _ in range(2):
        if np.count_nonzero(on_plane) < _LEAST_POINTS:
            return None
        center = near[on_plane].mean(axis=0)
        axes = np.linalg.svd(near[on_plane] - center, full_matrices=False)[2]
        normal = axes[2] * (1.0 if axes[2] @ up >= 0 else -1.0)
        if normal @ up < np.cos(np.radians(cone_degrees)):
            normal = searched  # too few points to fit a tilt; the direction of the search is more reliable
        low = float(center @ normal)
        on_plane = np.abs(near @ normal - low) < 1.5 * thickness
    share = np.count_nonzero(on_plane) / max(1, int(np.count_nonzero(near @ normal < 0)))
    heights = near @ normal - low
    above = np.count_nonzero((heights > 6 * thickness) & (heights < 12 * thickness)) / 2
    if share < _LEAST_SHARE or low >= 0 or np.count_nonzero(on_plane) < _CONTRAST * above:
        return None
    return FloorPlane(normal, float(low + origin @ normal), float(share))


def _directions(axis: NDArray[np.float64], spread: float, step: float) -> NDArray[np.float64]:
    """(K, 3) unit vectors within `spread` degrees of `axis`, about `step` degrees apart."""
    side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
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
    """The direction with the best floor below the origin, and the height of that floor; None if no layer qualifies."""
    best, best_score, best_height = None, 0, 0.0
    for direction in directions:
        heights = points @ direction
        heights = heights[(heights < 0) & (heights > -10_000 * thickness)]
        if len(heights) < _LEAST_POINTS:
            continue
        counts = np.bincount((-heights / thickness).astype(np.int64), minlength=2)
        on = counts[:-1] + counts[1:]  # a floor may straddle two layers
        below = np.maximum(len(heights) - np.cumsum(counts)[1:], 0)
        scores = on - np.append(below[1:], 0)  # points one layer below are noise of the floor itself
        lowest = int(np.argmax(scores))
        if scores[lowest] > best_score:
            best, best_score, best_height = direction, int(scores[lowest]), -(lowest + 1) * thickness
    return None if best is None else (best, best_height)
