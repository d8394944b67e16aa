"""Where points of the floor lie in a view, and how an image is read there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.sphere import Sphere

Eye = Camera | Sphere
"""What places of the world are looked up with: both project points to pixels, and say how far those are."""


@dataclass(frozen=True, eq=False)
class FloorPixels:
    """inside   (rows, cells) bool, whether a point lies in the image, with a pixel's grace at its border
    depth    (rows, cells) metres along the optical axis, of a panorama along the ray
    corners  (4, rows, cells) the pixels around each point, numbered through the image row by row: upper left and right,
             lower left and right; border pixels for what is outside; the last column of a panorama
             lies beside its first
    across, along  (rows, cells) how far between them the point lies, 0 to 1
    """

    inside: NDArray[np.bool_]
    depth: NDArray[np.float64]
    corners: NDArray[np.int64]
    across: NDArray[np.float64]
    along: NDArray[np.float64]

    @staticmethod
    def of(eye: Eye, points: NDArray[np.float64]) -> FloorPixels:
        """Of points (rows, cells, 3), metres, world."""
        pixels, depth = eye.project(points)
        wraps = isinstance(eye, Sphere)
        height, width = size_of(eye)
        u, v = pixels[..., 0], pixels[..., 1]
        inside = (depth > 0) & (u > -1) & (v > -1) & (u < width + 1) & (v < height + 1)
        # The centres of pixels lie at halves.
        u = (u - 0.5) % width if wraps else np.clip(u - 0.5, 0, width - 1)
        v = np.clip(v - 0.5, 0, height - 1)
        left, v0 = np.floor(u), v.astype(np.int64)
        u0 = left.astype(np.int64) % width  # a rounded remainder may be the width itself
        u1 = (u0 + 1) % width if wraps else np.minimum(u0 + 1, width - 1)
        upper, lower = v0 * width, np.minimum(v0 + 1, height - 1) * width
        corners = np.stack([upper + u0, upper + u1, lower + u0, lower + u1])
        return FloorPixels(np.asarray(inside | wraps), np.asarray(depth), corners, u - left, v - v0)

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


def size_of(eye: Eye) -> tuple[int, int]:
    """Height and width of its images, pixels."""
    size = eye if isinstance(eye, Sphere) else eye.intrinsics
    return size.height, size.width
