"""A capture of any format, read and aligned. Writes nothing."""

from __future__ import annotations

from pathlib import Path

from nvsim.capture.alignment import align, apply
from nvsim.capture.findings import IMAGE_MISSING, Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.image_folder import looked_for_in
from nvsim.capture.left_out import without
from nvsim.capture.raw import LOST_FRAME, RawFrame, file_size
from nvsim.capture.types import Alignment, Capture


def read(
    path: Path,
    *,
    scale: float | None = None,
    camera_height: float | None = None,
    alignment: Alignment | None = None,
    leave_out: str = "",
    images: str = "",
    model: str = "",
) -> Capture:
    """The capture at `path`, a folder or a file of it, in the aligned frame.

    scale          metres per unit of the source, when the source does not know
    camera_height  metres of the cameras above the floor; gives the scale of a source that has none
    alignment      known already, so that nothing is estimated
    leave_out      names of frames that are left out, with commas between them
    images         the folder in which images are looked for that do not lie where the capture says, "" for none
    model          which of several COLMAP models, by its folder; "" for the one with most images

    A capture of unknown scale still loads, with `alignment.scale_known` False. Raises InputError that names every
    error found, missing and empty images among them; images are not decoded (`check` does that).
    """
    findings = Findings()
    raw = looked_for_in(without(read_raw(path, findings, model), leave_out, findings), images)
    for frame in raw.frames:
        report_absent_image(frame, findings)
    findings.raise_errors(path)
    if alignment is None:
        alignment, _ = align(raw, scale, camera_height, findings)
    return apply(raw, alignment)


def report_absent_image(frame: RawFrame, findings: Findings) -> bool:
    """Whether the image is missing or empty, which becomes an error finding."""
    size = file_size(frame.image_path)
    if size is None:
        findings.error(IMAGE_MISSING, frame.where, f"{LOST_FRAME}; looked for {frame.image_path}")
    elif size == 0:
        findings.error("the image is empty (0 bytes)", frame.where, LOST_FRAME)
    return not size
