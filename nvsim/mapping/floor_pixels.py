"""Where points of the floor lie in a view, and how an image is read there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class FloorPixels:
    """inside   (rows, cells) bool, whether a point lies in the image, with a pixel's grace at its border
    depth    (rows, cells) metres along the optical axis
    corners  (4, rows, cells) the pixels around each point, numbered through the image row by row: upper left and right,
             lower left and right; border pixels for what is outside
    across, along  (rows, cells) how far between them the point lies, 0 to 1
    """

    inside: NDArray[np.bool_]
    depth: NDArray[np.float64]
    corners: NDArray[np.int64]
    across: NDArray[np.float64]
    along: NDArray[np.float64]

    @staticmethod
    def of(camera: Camera, points: NDArray[np.float64]) -> FloorPixels:
        """Of points (rows, cells, 3), metres, world."""
        pixels, depth = camera.project(points)
        u, v, k = pixels[..., 0], pixels[..., 1], camera.intrinsics
        inside = (depth > 0) & (u > -1) & (v > -1) & (u < k.width + 1) & (v < k.height + 1)
        # The centres of pixels lie at halves.
        u, v = np.clip(u - 0.5, 0, k.width - 1), np.clip(v - 0.5, 0, k.height - 1)
        u0, v0 = u.astype(np.int64), v.astype(np.int64)
        u1, upper = np.minimum(u0 + 1, k.width - 1), v0 * k.width
        lower = np.minimum(v0 + 1, k.height - 1) * k.width
        corners = np.stack([upper + u0, upper + u1, lower + u0, lower + u1])
        return FloorPixels(np.asarray(inside), np.asarray(depth), corners, u - u0, v - v0)

    @property
    def read(self) -> NDArray[np.int64]:
        """(n,) numbers of the pixels that points inside are read from."""
        return self.corners[:, self.inside].reshape(-1)

    def values(self, image: NDArray[np.float32]) -> NDArray[np.float64]:
        """(rows, cells) an image (H, W) at the points, bilinear."""
        upper_left, upper_right, lower_left, lower_right = image.reshape(-1).take(self.corners)
        top = upper_left * (1 - self.across) + upper_right * self.across
        bottom = lower_left * (1 - self.across) + lower_right * self.across
        return np.asarray(top * (1 - self.along) + bottom * self.along, np.float64)
