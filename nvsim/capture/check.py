"""The data check: find every problem of a capture before any work starts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import align, apply
from nvsim.capture.axes import Axes, with_axes
from nvsim.capture.black_borders import cut_black_borders
from nvsim.capture.dense_frames import report_near_duplicates
from nvsim.capture.depth_images import check_depths, report_depths
from nvsim.capture.findings import SCALE_UNKNOWN, Finding, Findings
from nvsim.capture.geometry_check import (
    check_cloud_meets_cameras,
    check_far_frames,
    check_floor_in_view,
    check_outliers,
    check_surroundings,
)
from nvsim.capture.image_folder import check_unused_images
from nvsim.capture.images import decode
from nvsim.capture.masks import check_masks
from nvsim.capture.raw import LOST_FRAME, RawCapture, RawFrame
from nvsim.capture.read import read_usable, report_absent_image
from nvsim.capture.summary import Summary, summary_of
from nvsim.capture.types import Alignment, Capture
from nvsim.capture.upright import turn_upright
from nvsim.errors import InputError

FEWEST = 4  # minimum number of frames without a LiDAR scan
_BLANK = 8  # gray levels between the darkest and the brightest 5 % of a blank image
_MOSTLY = 0.8  # share of blank images above which the capture is refused
_ONE_PLACE = 0.05  # meters; cameras within this extent are at one place
_OF_THE_SCENE = 0.005  # the same limit without a scale: share of the distance to the points of the point cloud
_SAMPLE = 5000  # points


def is_blank(image: NDArray[np.uint8]) -> bool:
    """Whether an image (H, W, 3) shows a single color: black, white, or the gray of a broken decoder."""
    step = max(1, min(image.shape[:2]) // 100)
    low, high = np.percentile(image[::step, ::step].mean(axis=2), (5, 95))
    return bool(high - low < _BLANK and np.ptp(np.percentile(image[::step, ::step], (0.5, 99.5))) < 4 * _BLANK)


def check_blank(frames: Sequence[RawFrame], blank: Sequence[RawFrame], findings: Findings) -> None:
    """An error if most of `frames` are `blank`, otherwise a warning for each blank frame."""
    if blank and len(blank) >= _MOSTLY * len(frames):
        findings.error(
            f"{len(blank)} of {len(frames)} images are blank: they show a single color",
            "the images",
            "there is nothing to reconstruct; record the images again, or copy them again from the camera",
        )
        return
    for frame in blank:
        findings.warning(
            "the image is blank: it shows a single color",
            frame.where,
            "it does not show the scene and may darken the trained models; --leave-out imports the capture without it",
            (frame.name,),
        )


def check_enough_frames(capture: Capture, findings: Findings) -> None:
    """Add an error for fewer than four frames, or a warning if a LiDAR scan or depth images show surfaces."""
    count, place = len(capture.frames), capture.source.name
    if count >= FEWEST:
        return
    message = f"the capture has only {count} frame{'' if count == 1 else 's'} with a pose"
    if _has_surfaces(capture):
        findings.warning(message, place, "trained models show only the content of these frames")
    else:
        findings.error(
            message,
            place,
            f"these are too few to estimate depth; at least {FEWEST} overlapping frames or a LiDAR scan are needed",
        )


def check_several_places(capture: Capture, findings: Findings) -> None:
    """Add an error if all cameras are at one place, or a warning if a LiDAR scan or depth images provide surfaces."""
    positions = capture.positions
    if len(positions) < 2:
        return
    extent = float(np.linalg.norm(np.ptp(positions, axis=0)))
    least = 1e-6 * max(1.0, float(np.abs(positions).max()))
    if capture.alignment.scale_known:
        least = max(least, _ONE_PLACE)
    elif capture.cloud is not None and len(capture.cloud.points):
        points = capture.cloud.points[:: max(1, len(capture.cloud.points) // _SAMPLE)]
        least = max(least, _OF_THE_SCENE * float(np.median(np.linalg.norm(points - positions[0], axis=1))))
    if extent > least:
        return
    unit = "m" if capture.alignment.scale_known else "units"
    message = f"all cameras are at one place (within {extent:.2g} {unit}), so the images have no parallax"
    place = capture.source.name
    if _has_surfaces(capture):
        findings.warning(message, place, "trained models show the scene from that place only")
    else:
        findings.error(
            message, place, "images without parallax give no depth; move the camera between images, or add a LiDAR scan"
        )


def _has_surfaces(capture: Capture) -> bool:
    return bool(capture.is_measured or capture.scans or capture.depths)


__all__ = ["Finding", "Report", "check"]
_ORDER = {"error": 0, "warning": 1, "note": 2}


@dataclass(frozen=True)
class Report:
    """All findings about one capture, errors first.

    `format` is "" if no format was recognized. `summary` is None if nothing could be read. `capture` is None if the
    capture cannot be transformed to the aligned frame. `raw` is the capture as stored in its files, before its poses
    are reinterpreted in the convention `axes`."""

    source: Path
    format: str
    findings: tuple[Finding, ...]
    summary: Summary | None = None
    capture: Capture | None = None
    raw: RawCapture | None = None
    axes: Axes = "auto"

    @property
    def refused(self) -> bool:
        """Whether an import refuses the capture."""
        return any(f.severity == "error" for f in self.findings)

    @property
    def bad_frames(self) -> tuple[str, ...]:
        """Names of the frames with errors. Leaving these frames out removes the errors."""
        return tuple(dict.fromkeys(name for f in self.findings if f.severity == "error" for name in f.frames))


def check(
    path: Path,
    scale: float | None = None,
    camera_height: float | None = None,
    leave_out: str = "",
    alignment: Alignment | None = None,
    images: str = "",
    axes: Axes = "auto",
    model: str = "",
) -> Report:
    """All findings about the capture at `path`, errors first.

    Every image is decoded. Frames named in `leave_out` (separated by commas) are skipped. Images that are not at their
    listed path are searched in the folder `images`. `axes` is the convention of the poses; `model` selects one of
    several COLMAP models. With an `alignment` from an earlier run, a capture without a point cloud is not aligned
    again. Bad data never raises an exception: a source that cannot be read gives a report with one error."""
    findings = Findings()
    path = Path(path)
    try:
        raw = read_usable(path, leave_out, images, findings, model)
    except InputError as error:
        findings.error(str(error).rstrip("."), str(path), "nothing can be read")
        return Report(path, "", _sort_findings(findings))
    _check_images(raw, findings)
    check_unused_images(raw, findings)
    raw = check_depths(check_masks(raw, findings), findings)
    capture, written = None, raw
    raw = cut_black_borders(raw, findings)
    raw = turn_upright(with_axes(raw, axes), findings, None if alignment is None else alignment.rotation[2])
    if any(f.camera_to_world is not None for f in raw.frames):
        capture = _check_geometry(raw, scale, camera_height, alignment, findings)
    names = {frame.where: (frame.name,) for frame in raw.frames}
    found = _sort_findings(replace(f, frames=f.frames or names.get(f.where, ())) for f in findings)
    report = Report(raw.source, raw.format, found, capture=capture, raw=written, axes=axes)
    return replace(report, summary=summary_of(raw, capture, frozenset(report.bad_frames)))


def _sort_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    return tuple(sorted(findings, key=lambda f: _ORDER[f.severity]))


def _check_images(raw: RawCapture, findings: Findings) -> None:
    """Decode all images in threads; the decoder releases the interpreter lock."""
    present = [f for f in raw.frames if not report_absent_image(f, findings)]
    blank = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for frame, (fault, shows_nothing) in zip(present, pool.map(_image_fault, present)):
            if fault is not None:
                findings.error(fault, frame.where, LOST_FRAME)
            elif shows_nothing:
                blank.append(frame)
    check_blank(present, blank, findings)


def _image_fault(frame: RawFrame) -> tuple[str | None, bool]:
    """The error message of an image (None if it can be decoded), and whether the image is blank."""
    try:
        size = None if frame.lens is None else (frame.lens.width, frame.lens.height)
        return None, is_blank(decode(frame.image_path, size))
    except InputError as error:
        return str(error).replace(str(frame.image_path), "the image").rstrip("."), False


def _check_geometry(
    raw: RawCapture,
    scale: float | None,
    camera_height: float | None,
    alignment: Alignment | None,
    findings: Findings,
) -> Capture | None:
    """Check poses, scale, and point cloud. Returns the capture in the aligned frame, or None if alignment fails."""
    floor = None
    if alignment is None or raw.cloud is not None:
        try:
            alignment, floor = align(raw, scale, camera_height, findings)
        except InputError as error:
            findings.error(str(error).rstrip("."), raw.source.name, "the capture cannot be scaled to meters")
            return None
    if not alignment.scale_known:
        findings.warning(
            SCALE_UNKNOWN,
            raw.source.name,
            "give the scale at import: --camera-height METERS above the floor, or --scale METERS per unit",
        )
    capture = apply(raw, alignment)
    report_depths(capture, findings)
    if not capture.frames:
        return capture
    check_enough_frames(capture, findings)
    check_several_places(capture, findings)
    where = {f.name: f.where for f in raw.frames}
    if not check_far_frames(capture, where, findings):
        return capture  # the far frames cause all further findings
    report_near_duplicates(capture, findings)
    check_outliers(capture, where, findings)
    check_surroundings(capture, findings)
    if check_cloud_meets_cameras(capture, findings):
        check_floor_in_view(capture, floor, findings)
    return capture
