"""Floor masks that a user corrected. A correction takes the place of the machine's mask wherever masks are used, and
outlives it: the floors may be found again, the correction stays.

Each is an image of its own, named after its frame, so that a capture that gains or loses frames keeps the right ones.
They are plain files: a user may correct masks while a job writes to the project's database.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import as_input_error, write_bytes
from nvsim.files.regular import read_bytes
from nvsim.project.layout import Layout

if TYPE_CHECKING:
    from nvsim.capture.types import Frame
    from nvsim.project.project import Project


def save_correction(layout: Layout, frame: Frame, mask: NDArray[np.bool_]) -> None:
    """Takes `mask` (H, W) bool, True on floor, of any size with the frame's proportions, for the floor of `frame`.
    Raises InputError when it cannot be written; what was there before stays."""
    import cv2

    encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])[1]
    write_bytes(layout.correction(frame.name), encoded.tobytes())


def remove_correction(layout: Layout, frame: Frame) -> None:
    """Goes back to the machine's mask. Raises InputError when the file cannot be removed."""
    path = layout.correction(frame.name)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise as_input_error(path, error) from error


def corrected_frames(layout: Layout, frames: Iterable[Frame]) -> frozenset[int]:
    """Indices into `frames` of those that have a correction."""
    try:
        there = {path.name for path in layout.corrections.iterdir()}
    except OSError:
        return frozenset()
    return frozenset(i for i, frame in enumerate(frames) if layout.correction(frame.name).name in there)


def mask_in_use(layout: Layout, frame: Frame, index: int) -> Path:
    """The image of the floor of `frame`, the `index`-th of the capture: its correction, else the machine's mask."""
    correction = layout.correction(frame.name)
    return correction if correction.is_file() else layout.mask(index)


def corrections_key(project: Project, frames: Iterable[int]) -> tuple[str, ...]:
    """What the corrections of the `frames` say, for the keys of the stages that use them: a hash of names and
    contents, nothing while there is none."""
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
    """Removes every correction of the project; returns how many there were. Raises InputError when one stays."""
    frames = project.need_capture().frames
    corrected = corrected_frames(project.layout, frames)
    for index in corrected:
        remove_correction(project.layout, frames[index])
    return len(corrected)
