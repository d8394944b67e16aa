"""Leave out nearly equal frames of a dense recording, such as one of a depth camera with 30 frames per second."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.images import decode
from nvsim.capture.types import Capture, Frame
from nvsim.errors import InputError

MANY = 250
"""Frames that are always kept: as many as are trained together."""
NEAR = 0.05
"""Meters between the cameras of nearly equal frames."""
ALIKE = 5.0
"""Degrees between their orientations."""
_DENSE = 0.2  # least share of nearly equal frames in a dense recording
_SIDE = 320  # pixels of the longer side of the images whose sharpness is compared


def without_near_duplicates(capture: Capture) -> Capture:
    """`capture` without frames whose camera is within 5 cm and 5 degrees of that of a kept frame.

    Of such frames, the sharpest is kept. All frames are kept if there are at most 250, or if fewer than a fifth are
    nearly equal to others. Positions are in meters, so the scale must be known or assumed. Frames of different sensors
    are not compared."""
    groups = _groups(capture.frames)
    if not _is_dense(len(capture.frames), len(groups)):
        return capture
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        kept = sorted(pool.map(lambda group: _sharpest(capture.frames, group), groups))
    frames = tuple(capture.frames[i] for i in kept)
    gone = {f.name for f in capture.frames} - {f.name for f in frames}
    depths = tuple(depth for depth in capture.depths if depth.frame not in gone)
    return replace(capture, frames=frames, depths=depths)


def report_near_duplicates(capture: Capture, findings: Findings) -> None:
    """Add a note about frames that `without_near_duplicates` would leave out."""
    count = len(capture.frames)
    if count <= MANY or not capture.alignment.scale_known:
        return
    kept = len(_groups(capture.frames))
    if _is_dense(count, kept):
        findings.note(
            f"{count - kept} of {count} frames are nearly equal to others",
            capture.source.name,
            f"of frames within {100 * NEAR:.0f} cm and {ALIKE:.0f} degrees of each other, the sharpest is imported",
        )


def _is_dense(count: int, kept: int) -> bool:
    return count > MANY and kept <= (1 - _DENSE) * count


def _groups(frames: Sequence[Frame]) -> list[list[int]]:
    """Indices of frames in groups. Each group starts with a frame that is far from all earlier first frames."""
    poses = np.array([f.camera_to_world for f in frames])
    groups: dict[str, list[list[int]]] = {}
    for index, frame in enumerate(frames):
        mine = groups.setdefault(frame.sensor, [])
        first = poses[[group[0] for group in mine]] if mine else poses[:0]
        near = np.flatnonzero(_is_alike(first, poses[index]))
        if len(near):
            mine[int(near[-1])].append(index)
        else:
            mine.append([index])
    return [group for found in groups.values() for group in found]


def _is_alike(poses: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) bool: whether each of `poses` (N, 4, 4) is near `pose` (4, 4) and has nearly its orientation."""
    near = np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1) < NEAR
    trace = np.einsum("nij,ij->n", poses[:, :3, :3], pose[:3, :3])
    return np.asarray(near & (trace > 1 + 2 * np.cos(np.radians(ALIKE))))


def _sharpest(frames: Sequence[Frame], group: Sequence[int]) -> int:
    """The index of the sharpest image of a group. An image that cannot be decoded is not chosen unless it is the only
    one."""
    if len(group) == 1:
        return group[0]
    return max(group, key=lambda index: _sharpness(frames[index]))


def _sharpness(frame: Frame) -> float:
    """The variance of the Laplacian of a small copy, -1 if the image cannot be decoded."""
    try:
        image = cv2.cvtColor(decode(frame.image_path), cv2.COLOR_RGB2GRAY)
    except InputError:
        return -1.0
    height, width = image.shape
    scale = _SIDE / max(height, width)
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_32F).var())
