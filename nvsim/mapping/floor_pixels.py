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
             lower left and right; 0 for what is outside; the last column of a panorama lies beside its
             first
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
        from nvsim.mapping import floor_kernels

        shape, wraps = points.shape[:2], isinstance(eye, Sphere)
        inside, depth = np.empty(shape, np.bool_), np.empty(shape)
        corners, across, along = np.empty((4, *shape), np.int64), np.empty(shape), np.empty(shape)
        if isinstance(eye, Camera):
            k = eye.intrinsics
            pixels = np.empty((*shape, 2))
            floor_kernels.project(points, eye.world_to_camera, np.array([k.fx, k.fy, k.cx, k.cy]), pixels, depth)
        else:
            pixels, depth = eye.project(points)
        floor_kernels.place(pixels, depth, *size_of(eye), wraps, inside, corners, across, along)
        return FloorPixels(inside, depth, corners, across, along)

    def mark(self, image: NDArray[np.bool_]) -> None:
        """Makes the pixels of an image (H, W) True that points inside are read from."""
        from nvsim.mapping import floor_kernels

        floor_kernels.mark(self.corners, self.inside, image)

    def are_marked(self, image: NDArray[np.bool_]) -> bool:
        """Whether all of these pixels are True in an image (H, W)."""
        from nvsim.mapping import floor_kernels

        return bool(floor_kernels.are_marked(self.corners, self.inside, image))

    def values(self, image: NDArray[np.float32], outside: float) -> NDArray[np.float64]:
        """(rows, cells) an image (H, W) at the points inside, bilinear, and a value for those outside."""
        from nvsim.mapping import floor_kernels

        found = np.empty(self.inside.shape)
        floor_kernels.read(
            np.ascontiguousarray(image), self.corners, self.across, self.along, self.inside, outside, found
        )
        return found


def size_of(eye: Eye) -> tuple[int, int]:
    """Height and width of its images, pixels."""
    size = eye if isinstance(eye, Sphere) else eye.intrinsics
    return size.height, size.width
