"""Tell whether images show the floor beyond the middle of a line. If images on one side show it, no wall is between the
two sides, although there may be a glass pane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.mapping.corridor import HeightAt

_NEAR = 8.0  # meters from a camera to floor that it shows
_BEFORE = 0.3  # meters of a camera before the middle of the line
_CLOSE = 0.2  # meters; floor nearer along the optical axis is not examined
_TOLERANCE = 0.08  # difference of depth, as a share of it
_LEAST = 2  # images; a single one can have a wrong depth
_KEPT = 40  # depth maps in memory, 50 MB at 640 x 480 pixels


class SeenFloor:
    """The floor that images show, by their depth.

    cameras   of the N images
    depth     index of an image -> (H, W) float32 depth in meters along the optical axis, 0 where unknown
    floor_at  height of the floor at world points, whose z selects the storey
    """

    def __init__(
        self, cameras: Sequence[Camera], depth: Callable[[int], NDArray[np.float32]], floor_at: HeightAt
    ) -> None:
        self._cameras, self._floor_at = cameras, floor_at
        self._depth = lru_cache(_KEPT)(depth)
        self._places = np.array([camera.position for camera in cameras]).reshape(-1, 3)

    def is_seen_across(self, a: tuple[float, ...], b: tuple[float, ...]) -> bool:
        """Whether at least two images from one half of the line between two cameras (x, y, z) show the floor at the end
        of the other half."""
        ends = np.array([a, b], np.float64)
        return any(self._is_end_seen(*pair) for pair in (ends, ends[::-1]))

    def _is_end_seen(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
        way = end[:2] - start[:2]
        way = way / max(float(np.hypot(*way)), 1e-9)
        place = np.array([*end[:2], float(self._floor_at(end[None])[0])])
        near = np.linalg.norm(self._places - end, axis=1) < _NEAR
        before = (self._places[:, :2] - (start + end)[:2] / 2) @ way < -_BEFORE
        found = 0
        for i in np.flatnonzero(near & before).tolist():
            found += self._shows(i, place)
            if found == _LEAST:
                return True
        return False

    def _shows(self, index: int, place: NDArray[np.float64]) -> bool:
        camera = self._cameras[index]
        (u, v), depth = camera.project(place)
        size = camera.intrinsics
        if depth < _CLOSE or not (0 <= u < size.width and 0 <= v < size.height):
            return False
        known = self._depth(index)
        row, column = int(v * known.shape[0] / size.height), int(u * known.shape[1] / size.width)
        return bool(abs(float(known[row, column]) - depth) < _TOLERANCE * depth)
