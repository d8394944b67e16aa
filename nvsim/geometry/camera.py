"""A pinhole camera in the world: OpenCV axes (x right, y down, z forward), world in meters with z up.

Pixel (0.5, 0.5) is the center of the first pixel, so a principal point in the image center is (width/2, height/2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating]


@dataclass(frozen=True)
class Intrinsics:
    """An undistorted pinhole camera: focal lengths and principal point in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def scaled(self, width: int, height: int) -> Intrinsics:
        """The pinhole of this view at another image size in pixels."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)

    def limited_to(self, longest_side: int) -> Intrinsics:
        """The pinhole of this view, shrunk so that neither side exceeds `longest_side` pixels; never enlarged."""
        factor = min(1.0, longest_side / max(self.width, self.height))
        return self.scaled(max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def turned(self, turns: int) -> Intrinsics:
        """The pinhole of this view after `turns` counterclockwise quarter turns of the image, as `numpy.rot90` makes
        them."""
        turned = self
        for _ in range(turns % 4):
            k = turned
            turned = Intrinsics(k.height, k.width, k.fy, k.fx, k.cy, k.width - k.cx)
        return turned

    def ray_lengths(self) -> NDArray[np.float32]:
        """(H, W) float32 meters along the ray of each pixel per meter along the optical axis."""
        u, v = (np.arange(self.width) + 0.5 - self.cx) / self.fx, (np.arange(self.height) + 0.5 - self.cy) / self.fy
        return np.sqrt(1 + u[None, :] ** 2 + v[:, None] ** 2).astype(np.float32)

    @staticmethod
    def from_fov(width: int, height: int, horizontal_fov: float) -> Intrinsics:
        """Square pixels, centered principal point, `horizontal_fov` in radians."""
        focal = width / 2 / np.tan(horizontal_fov / 2)
        return Intrinsics(width, height, focal, focal, width / 2, height / 2)


def quarter_turns(turns: int) -> NDArray[np.float64]:
    """(3, 3) float64, exact: maps directions in a camera to the camera whose image has `turns` counterclockwise quarter
    turns more. OpenCV axes."""
    return np.linalg.matrix_power(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), turns % 4)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a pose. `camera_to_world` is (4, 4) float64, rigid, meters."""

    intrinsics: Intrinsics
    camera_to_world: NDArray[np.float64]

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) meters, world."""
        return self.camera_to_world[:3, 3]

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3), columns are the camera's right, down, and forward axes in the world."""
        return self.camera_to_world[:3, :3]

    @cached_property
    def world_to_camera(self) -> NDArray[np.float64]:
        """(4, 4), the inverse of the pose."""
        inverse = np.eye(4)
        inverse[:3, :3] = self.rotation.T
        inverse[:3, 3] = -self.rotation.T @ self.position
        return inverse

    def scaled(self, width: int, height: int) -> Camera:
        """This camera at another image size in pixels."""
        return replace(self, intrinsics=self.intrinsics.scaled(width, height))

    def rays(self) -> NDArray[np.float32]:
        """(H, W, 3) float32 unit directions in the world through the pixel centers."""
        k = self.intrinsics
        u = (np.arange(k.width) + 0.5 - k.cx) / k.fx
        v = (np.arange(k.height) + 0.5 - k.cy) / k.fy
        local = np.empty((k.height, k.width, 3))
        local[..., 0], local[..., 1], local[..., 2] = u[None, :], v[:, None], 1.0
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return (local @ self.rotation.T).astype(np.float32)

    def project(self, points: FloatArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (..., 2) and depths (...,) in meters along the optical axis of world points (..., 3), meters. A depth
        <= 0 is behind the camera."""
        local = points @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        depth = local[..., 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        k = self.intrinsics
        pixels = np.stack([k.fx * local[..., 0] / safe + k.cx, k.fy * local[..., 1] / safe + k.cy], axis=-1)
        return pixels, depth


def camera_pose(position: FloatArray, heading: float, elevation: float = 0.0) -> NDArray[np.float64]:
    """A level camera-to-world pose (4, 4) at `position` (3,), meters. The convention is Matterport3DSimulator's.

    `heading` is in radians: 0 is +y, positive turns right (clockwise seen from above). `elevation` is in radians:
    positive looks up."""
    sh, ch, se, ce = (float(f(x)) for x in (heading, elevation) for f in (np.sin, np.cos))
    right, forward = (ch, -sh, 0.0), (sh * ce, ch * ce, se)
    pose = np.eye(4)
    # numpy's cross product would take as long as all other work for a view before rendering.
    down = [forward[i - 2] * right[i - 1] - forward[i - 1] * right[i - 2] for i in range(3)]
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, down, forward, position
    return pose


_LYING = 0.3  # horizontal length below which the right axis of a camera does not define its heading


def level_of(camera: Camera) -> NDArray[np.float64]:
    """(3, 3) float64; rows are right, down, and forward in the world. It maps world vectors to the level frame.

    The heading comes from the camera's right axis, so it is defined even if the camera looks straight down. If the
    image is rotated by a quarter turn, the heading comes from the optical axis.
    """
    right = np.array([camera.rotation[0, 0], camera.rotation[1, 0], 0.0])
    if np.linalg.norm(right) < _LYING:
        forward = camera.rotation[:, 2]
        right = np.array([forward[1], -forward[0], 0.0])
    length = float(np.linalg.norm(right))
    right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([right, (0.0, 0.0, -1.0), (-right[1], right[0], 0.0)])


def level_rays(camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) float32 unit directions through the pixel centers, in the level frame of the camera."""
    return np.asarray(camera.rays() @ level_of(camera).T, np.float32)
