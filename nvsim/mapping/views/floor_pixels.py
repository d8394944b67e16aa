"""Find points of the floor in a view, and read images at these points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere

Eye = Camera | Sphere
"""A camera or a panorama. Both project world points to pixels and give their distance."""


@dataclass(frozen=True, eq=False)
class FloorPixels:
    """The pixels of floor points in a view.

    inside                  (rows, cells) bool, whether a point is in the image, with a tolerance of one pixel at its
                            border
    depth                   (rows, cells) meters along the optical axis, or along the ray for a panorama
    corners                 (4, rows, cells) the pixels around each point, numbered through the image row by row: upper
                            left and right, lower left and right; 0 for points outside; the last column of a panorama is
                            beside its first
    fraction_x, fraction_y  (rows, cells) position of the point between these pixels, 0 to 1
    """

    inside: NDArray[np.bool_]
    depth: NDArray[np.float64]
    corners: NDArray[np.int64]
    fraction_x: NDArray[np.float64]
    fraction_y: NDArray[np.float64]

    @staticmethod
    def of(eye: Eye, points: NDArray[np.float64]) -> FloorPixels:
        """Find points (rows, cells, 3), meters, world, in the image of `eye`."""
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
        floor_kernels.locate_points(pixels, depth, *size_of(eye), wraps, inside, corners, across, along)
        return FloorPixels(inside, depth, corners, across, along)

    def mark(self, image: NDArray[np.bool_]) -> None:
        """Set the pixels that points inside are read from to True in an image (H, W)."""
        from nvsim.mapping import floor_kernels

        floor_kernels.mark_pixels(self.corners, self.inside, image)

    def are_marked(self, image: NDArray[np.bool_]) -> bool:
        """Whether all of these pixels are True in an image (H, W)."""
        from nvsim.mapping import floor_kernels

        return bool(floor_kernels.are_marked(self.corners, self.inside, image))

    def values(self, image: NDArray[np.float32], outside: float) -> NDArray[np.float64]:
        """Return (rows, cells): an image (H, W) at the points inside, bilinear, and `outside` at all other points."""
        from nvsim.mapping import floor_kernels

        found = np.empty(self.inside.shape)
        floor_kernels.read(
            np.ascontiguousarray(image), self.corners, self.fraction_x, self.fraction_y, self.inside, outside, found
        )
        return found


def size_of(eye: Eye) -> tuple[int, int]:
    """Return height and width in pixels of the images of `eye`."""
    size = eye if isinstance(eye, Sphere) else eye.intrinsics
    return size.height, size.width
