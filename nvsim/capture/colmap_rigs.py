"""Poses of images on COLMAP rigs (COLMAP 3.12 and later): world-to-camera = (rig-to-camera) (world-to-rig).

Like COLMAP, NVSim takes the pose of such an image from its frame and ignores the pose in the list of images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.colmap_rows import FrameRow, ImageRow, RigRow
from nvsim.capture.findings import Findings
from nvsim.capture.raw import pose_from_quaternion

Pose = NDArray[np.float64]
_SAME = 1e-4  # tolerance of rotation entries, and of a translation relative to its length


@dataclass(frozen=True)
class Placement:
    """Pose and rig of one image.

    pose    world-to-camera (4, 4), None if neither its frame nor the list of images gives one
    rig     id of the rig, "" if the rig has a single camera or there is no rig
    moment  id of the frame if the rig has several cameras, otherwise id of the image
    """

    pose: Pose | None
    rig: str
    moment: float


def place_images(
    images: Sequence[ImageRow], rigs: Sequence[RigRow], frames: Sequence[FrameRow], findings: Findings
) -> list[Placement]:
    """The placement of each of `images`. If an image is on a frame, its pose comes from the frame and the rig;
    otherwise from the list of images."""
    by_number = {rig.number: rig for rig in rigs}
    numbers = {row.number for row in images}
    on_frame: dict[int, tuple[FrameRow, RigRow]] = {}
    for frame in frames:
        rig = by_number.get(frame.rig)
        if rig is None:
            findings.warning(f"the frame names rig {frame.rig}, which is not listed", frame.where, "it is not used")
            continue
        for number in frame.images:
            on_frame[number] = frame, rig
            if number not in numbers:
                message = f"the frame names image {number}, which is not in the list of images"
                findings.warning(message, frame.where, "the image is not read, as its name is unknown")
    return [_placement(row, on_frame.get(row.number), findings) for row in images]


def _placement(row: ImageRow, on: tuple[FrameRow, RigRow] | None, findings: Findings) -> Placement:
    where = f"{row.where} ({row.name})"
    pose, rig_name, moment = None, "", float(row.number)
    if on is not None:
        frame, rig = on
        pose = _pose_on(frame, rig, row.camera)
        if len(rig.cameras) > 1:
            rig_name, moment = str(rig.number), float(frame.number)
    if pose is None:
        return Placement(pose_from_quaternion(row.quaternion, row.translation, where, findings), rig_name, moment)
    listed = pose_from_quaternion(row.quaternion, row.translation, where, Findings())
    if listed is not None and _differ(listed, pose):
        findings.warning(
            "the pose in the list of images differs from that of the rig's frame",
            where,
            "the pose of the frame is used, as in COLMAP",
        )
    return Placement(pose, rig_name, moment)


def _pose_on(frame: FrameRow, rig: RigRow, camera: int) -> Pose | None:
    """World-to-camera (4, 4), None if the frame or the rig has no pose for this camera."""
    world_to_rig = pose_from_quaternion(frame.quaternion, frame.translation, frame.where, Findings())
    rig_to_camera = _mount(rig, camera)
    return None if world_to_rig is None or rig_to_camera is None else rig_to_camera @ world_to_rig


def _differ(one: Pose, other: Pose) -> bool:
    length = max(float(np.linalg.norm(other[:3, 3])), 1.0)
    turned = float(np.abs(one[:3, :3] - other[:3, :3]).max())
    return turned > _SAME or float(np.linalg.norm(one[:3, 3] - other[:3, 3])) > _SAME * length


def _mount(rig: RigRow, camera: int) -> Pose | None:
    """Rig-to-camera (4, 4), None if the rig does not list the camera or its pose."""
    if camera == rig.reference:
        return np.eye(4)
    mount = rig.mounts.get(camera)
    return None if mount is None else pose_from_quaternion(*mount, rig.where, Findings())
