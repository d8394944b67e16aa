"""Read and align a capture of any format. It writes no files."""

from __future__ import annotations

from pathlib import Path

from nvsim.capture.alignment import align, apply
from nvsim.capture.axes import Axes, with_axes
from nvsim.capture.findings import IMAGE_AMBIGUOUS, IMAGE_MISSING, Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.image_folder import find_moved_images, resolve_images_in
from nvsim.capture.image_sizes import fit_lenses
from nvsim.capture.left_out import without
from nvsim.capture.masks import with_masks_beside
from nvsim.capture.origin import subtract_origin
from nvsim.capture.raw import LOST_FRAME, RawCapture, RawFrame, file_size
from nvsim.capture.types import Alignment, Capture
from nvsim.errors import shown
from nvsim.files.placeholders import absence


def read(
    path: Path,
    *,
    scale: float | None = None,
    camera_height: float | None = None,
    alignment: Alignment | None = None,
    leave_out: str = "",
    images: str = "",
    axes: Axes = "auto",
    model: str = "",
) -> Capture:
    """The capture at `path`, a folder or a file of it, in the aligned frame.

    scale          meters per unit of the source, if the source does not state it
    camera_height  meters of the cameras above the floor; gives the scale of a source without one
    alignment      a known alignment; nothing is estimated then
    leave_out      names of frames to leave out, separated by commas
    images         folder in which missing images are searched, "" for none
    axes           convention of the poses in the files
    model          which of several COLMAP models, by its folder; "" for the one with the most images

    A capture of unknown scale is loaded with `alignment.scale_known` False. Raises InputError that lists every error,
    including missing and empty images. Images are not decoded; `check` does that.
    """
    findings = Findings()
    raw = with_axes(read_usable(path, leave_out, images, findings, model), axes)
    for frame in raw.frames:
        report_absent_image(frame, findings)
    findings.raise_errors(path)
    if alignment is None:
        alignment, _ = align(raw, scale, camera_height, findings)
    return apply(raw, alignment)


def read_usable(path: Path, leave_out: str, images: str, findings: Findings, model: str = "") -> RawCapture:
    """The capture at `path` before alignment, as `check` and `read` use it. `model` selects one of several COLMAP
    models.

    Frames named in `leave_out` are removed, moved files are found, lenses are fitted to the sizes of their images, and
    a far origin is subtracted. Raises InputError if nothing can be read."""
    raw = resolve_images_in(without(read_raw(path, findings, model), leave_out, findings), images)
    raw = with_masks_beside(find_moved_images(raw, findings))
    raw = fit_lenses(raw, findings)
    return subtract_origin(raw, findings)


def report_absent_image(frame: RawFrame, findings: Findings) -> bool:
    """Whether the image is missing or empty; if so, adds an error finding."""
    size = file_size(frame.image_path)
    if size is None and frame.choices:
        folders = ", ".join(shown(folder) for folder in frame.choices[:4])
        findings.error(IMAGE_AMBIGUOUS, frame.where, f"{LOST_FRAME}; found in {folders}")
    elif size is None:
        why = absence(frame.image_path)
        looked = f"{LOST_FRAME}; looked for {shown(frame.image_path)}" + (f", which {why}" if why else "")
        below = f", and for its name below {shown(frame.root)}" if frame.root is not None else ""
        findings.error(IMAGE_MISSING, frame.where, f"{looked}{below}; --images FOLDER names another place")
    elif size == 0:
        findings.error("the image is empty (0 bytes)", frame.where, LOST_FRAME)
    return not size
