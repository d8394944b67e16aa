"""Directions around a position: an equirectangular image, the six faces of a skybox, the 36 views of a viewpoint, and
the cameras that take them.

In the equirectangular image, columns are headings, increasing to the right; rows are elevations from +90 degrees down
to -90. World in meters with z up; heading 0 is +y.

Faces: those of Matterport3DSimulator's skybox strips `<id>_skybox_small.jpg`: up, back, left, front, right, down, side
by side; front is the viewing direction of the pose. Camera axes are OpenCV's: x right, y down, z forward.

Views: those of Matterport3DSimulator with `setDiscretizedViewingAngles(True)`; the order is that of its viewIndex.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, FloatArray, Intrinsics, camera_pose


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


NAMES = ("up", "back", "left", "front", "right", "down")

# The axes of each face in the camera's frame: the directions of u (right in the face), of r (down in the face), and of
# the face itself.
_RIGHT = np.array([[-1, 0, 0], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], float)
_DOWN = np.array([[0, 0, -1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]], float)
_AHEAD = np.array([[0, -1, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], float)


def face_axes() -> NDArray[np.float64]:
    """(6, 3, 3) rotations from each face's own camera to the pose's camera: columns are right, down, and forward."""
    return np.stack([_RIGHT, _DOWN, _AHEAD], -1)


def face_rays(side: int) -> NDArray[np.float64]:
    """(6, side, side, 3) float64 directions through the pixel centers, in the camera's frame. Their length along the
    axis of their face is 1 (they are not unit vectors)."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    right, down = np.meshgrid(along, along)
    return np.stack([right, down, np.ones_like(right)], -1) @ np.swapaxes(face_axes(), -1, -2)[:, None]


VIEWS = 36  # three elevations of twelve headings
WIDTH, HEIGHT = 640, 480
VFOV = math.radians(60)
HEADINGS = 12
STEP = math.radians(30)
"""Angle between headings, and between elevations, radians."""


def heading_and_elevation(index: int) -> tuple[float, float]:
    """Heading and elevation of the view `index`, in radians: heading 0 is +y, positive turns right; positive elevation
    looks up."""
    return index % HEADINGS * STEP, (index // HEADINGS - 1) * STEP


def sweep(position: NDArray[np.floating], width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    """The 36 cameras at `position` (3,), meters, world, in the order of viewIndex."""
    focal = height / 2 / math.tan(VFOV / 2)
    intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    at = np.asarray(position, np.float64)
    return [Camera(intrinsics, camera_pose(at, *heading_and_elevation(i))) for i in range(VIEWS)]


_RIGHT_ANGLE = math.pi / 2


def cube(position: NDArray[np.floating], side: int, offset: float = 0.0) -> list[Camera]:
    """Six views from `position` (3,), meters, of 90 degrees and `side` x `side` pixels: up, four headings clockwise
    from `offset` (radians) on, down. Up has heading `offset` at its lower edge, down at its upper edge."""
    intrinsics = Intrinsics.from_fov(side, side, _RIGHT_ANGLE)
    at = np.asarray(position, np.float64)
    turns = [(offset, _RIGHT_ANGLE), *((offset + k * _RIGHT_ANGLE, 0.0) for k in range(4)), (offset, -_RIGHT_ANGLE)]
    return [Camera(intrinsics, camera_pose(at, heading, elevation)) for heading, elevation in turns]


def skybox(faces: list[NDArray[np.generic]]) -> NDArray[np.generic]:
    """Six square images (S, S, ...) in the order of `cube` as one strip (S, 6 S, ...): up, back, left, front, right,
    down. These are the order and orientation of Matterport's skyboxes for a viewpoint whose pose looks along the cube's
    heading. The lower edge of up and the upper edge of down touch the back."""
    up, front, right, back, left, down = faces
    return np.concatenate([np.rot90(up, 2), back, left, front, right, np.rot90(down, 2)], axis=1)
