"""Axis conventions of camera poses, and poses reinterpreted in another convention than the format's own.

A convention names the directions of the camera's x, y, and z axes. A left-handed convention also has a left-handed
world; its y axis is reversed to make it right-handed. "-inverse" means that the file stores the opposite direction of
its format's definition: world to camera where the format defines camera to world, or the reverse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import RawCapture, RawFrame, inverse
from nvsim.capture.types import Cloud

Axes = Literal["auto", "opencv", "opengl", "ros", "unity", "unreal", "opencv-inverse", "opengl-inverse"]
"""The convention of the poses in the files; "auto" is the convention of the format."""
CHOICES: tuple[Axes, ...] = get_args(Axes)

_AXES = {
    # Columns are the x, y, and z axes of the convention, in OpenCV's axes (right, down, forward).
    "opencv": np.eye(3),
    "opengl": np.diag([1.0, -1.0, -1.0]),  # right, up, back
    "ros": np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),  # forward, left, up
    "unity": np.diag([1.0, -1.0, 1.0]),  # right, up, forward; left-handed
    "unreal": np.array([[0.0, 1, 0], [0, 0, -1], [1, 0, 0]]),  # forward, right, up; left-handed
}
DESCRIPTIONS = {
    "opencv": "OpenCV's axes (x right, y down, z forward)",
    "opengl": "OpenGL's axes (x right, y up, z back)",
    "ros": "the axes of ROS (x forward, y left, z up)",
    "unity": "Unity's left-handed axes (x right, y up, z forward)",
    "unreal": "Unreal's left-handed axes (x forward, y right, z up)",
}
_MIRRORED = np.diag([1.0, -1.0, 1.0, 1.0])


def convert_axes(pose: NDArray[np.float64], own: str, axes: Axes) -> NDArray[np.float64]:
    """The camera-to-world pose (..., 4, 4) with OpenCV axes, if the file uses the convention `axes`.

    `pose` (..., 4, 4) was read with the format's `own` axes ("opencv" or "opengl")."""
    if axes == "auto":
        return pose
    written = pose @ _homogeneous(own)
    name, _, opposite = axes.partition("-")
    if opposite:
        turned = np.swapaxes(written[..., :3, :3], -1, -2)
        inverted = written.copy()
        inverted[..., :3, :3] = turned
        inverted[..., :3, 3] = -(turned @ written[..., :3, 3, None])[..., 0]
        written = inverted
    result = written @ _homogeneous(name).T
    return np.asarray(_MIRRORED @ result if is_left_handed(axes) else result)


def is_left_handed(axes: Axes) -> bool:
    return axes != "auto" and bool(np.linalg.det(_AXES[axes.partition("-")[0]]) < 0)


def with_axes(raw: RawCapture, axes: Axes) -> RawCapture:
    """`raw` with its poses reinterpreted in the convention `axes`. Depth images move with their frames. If the world
    is left-handed, the point cloud is mirrored too."""
    if axes == "auto":
        return raw
    frames = tuple(_convert_frame(frame, axes) for frame in raw.frames)
    moved = {
        old.name: new.camera_to_world @ inverse(old.camera_to_world)
        for old, new in zip(raw.frames, frames, strict=True)
        if old.camera_to_world is not None and new.camera_to_world is not None
    }
    depths = tuple(
        replace(d, camera_to_world=moved[d.frame] @ d.camera_to_world)
        if d.frame in moved
        else replace(d, camera_to_world=convert_axes(d.camera_to_world, "opencv", axes))
        for d in raw.depths
    )
    cloud = raw.cloud
    if cloud is not None and is_left_handed(axes):
        cloud = Cloud(cloud.points * np.array([1, -1, 1], np.float32), cloud.colors, cloud.kind)
    return replace(raw, frames=frames, depths=depths, cloud=cloud)


def _convert_frame(frame: RawFrame, axes: Axes) -> RawFrame:
    pose = frame.camera_to_world
    return frame if pose is None else replace(frame, camera_to_world=convert_axes(pose, frame.axes, axes))


def _homogeneous(name: str) -> NDArray[np.float64]:
    full = np.eye(4)
    full[:3, :3] = _AXES[name]
    return full
