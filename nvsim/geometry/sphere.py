"""All directions around a position as an equirectangular image. Columns are headings, increasing to the right; rows are
elevations from +90 degrees down to -90. World in meters with z up; heading 0 is +y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import FloatArray


@dataclass(frozen=True, eq=False)
class Sphere:
    """position  (3,) meters, world
    width, height  pixels; pixels are square if the width is twice the height
    heading  radians, of the middle column; the left edge is half a turn from it
    """

    position: NDArray[np.float64]
    width: int
    height: int
    heading: float = 0.0

    def rays(self) -> NDArray[np.float32]:
        """(H, W, 3) float32 unit directions in the world through the pixel centers."""
        heading = ((np.arange(self.width) + 0.5) / self.width - 0.5) * 2 * np.pi + self.heading
        elevation = (0.5 - (np.arange(self.height) + 0.5) / self.height)[:, None] * np.pi
        flat = np.cos(elevation)
        rays = np.stack(np.broadcast_arrays(flat * np.sin(heading), flat * np.cos(heading), np.sin(elevation)), axis=-1)
        return rays.astype(np.float32)

    def project(self, points: FloatArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (..., 2), with x from 0 to the width, and distances (...,) in meters of world points (..., 3)."""
        way = np.asarray(points, np.float64) - self.position
        distance = np.linalg.norm(way, axis=-1)
        turn = (np.arctan2(way[..., 0], way[..., 1]) - self.heading) / (2 * np.pi) + 0.5
        rise = np.arctan2(way[..., 2], np.hypot(way[..., 0], way[..., 1])) / np.pi
        return np.stack([turn % 1.0 * self.width, (0.5 - rise) * self.height], axis=-1), distance
