"""Floor masks that a user corrected. A correction replaces NVSim's mask wherever masks are used. It remains when the
floor is found again.

Each correction is an image file named after its frame, so that it stays with its frame if the capture gains or loses
frames. Corrections are plain files, so that users can edit masks while a job writes to the database.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import as_input_error, write_bytes
from nvsim.files.opening import read_bytes
from nvsim.project.layout import Layout
from nvsim.project.project import Project

if TYPE_CHECKING:
    from nvsim.capture.types import Frame


def save_correction(layout: Layout, frame: Frame, mask: NDArray[np.bool_]) -> None:
    """Stores `mask` (H, W) bool, True on floor, as the floor of `frame`. The mask may have any size with the frame's
    proportions. Raises InputError if it cannot be written; an earlier correction then stays."""
    import cv2

    encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])[1]
    write_bytes(layout.correction(frame.name), encoded.tobytes())


def remove_correction(layout: Layout, frame: Frame) -> None:
    """Removes the correction, so that NVSim's mask is used. Raises InputError if the file cannot be removed."""
    path = layout.correction(frame.name)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise as_input_error(path, error) from error


def corrected_frames(layout: Layout, frames: Iterable[Frame]) -> frozenset[int]:
    """Indices of the `frames` that have a correction."""
    try:
        there = {path.name for path in layout.corrections.iterdir()}
    except OSError:
        return frozenset()
    return frozenset(i for i, frame in enumerate(frames) if layout.correction(frame.name).name in there)


def corrections_key(project: Project, frames: Iterable[int]) -> tuple[str, ...]:
    """Hash of the corrections of `frames` (names and contents) for the keys of stages that use them; empty if there are
    none. Raises InputError if a correction cannot be read."""
    capture = project.capture()
    if capture is None:
        return ()
    corrected = corrected_frames(project.layout, capture.frames) & set(frames)
    if not corrected:
        return ()
    digest = hashlib.sha256()
    for index in sorted(corrected):
        name = capture.frames[index].name
        digest.update(name.encode("utf-8", "surrogatepass") + b"\0" + read_bytes(project.layout.correction(name)))
    return (digest.hexdigest()[:24],)


def discard_corrections(project: Project) -> int:
    """Removes all corrections of the project and returns their number. Raises InputError if one cannot be removed."""
    frames = project.need_capture().frames
    corrected = corrected_frames(project.layout, frames)
    for index in corrected:
        remove_correction(project.layout, frames[index])
    return len(corrected)
