"""The data check: everything that is wrong with a capture, found before any work starts."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from nvsim.capture.alignment import align, apply
from nvsim.capture.far_frames import check_far_frames, without
from nvsim.capture.findings import Finding, Findings, Report
from nvsim.capture.formats import read_raw
from nvsim.capture.geometry_check import check_cloud_meets_cameras, check_floor_in_view, check_outliers
from nvsim.capture.images import decode
from nvsim.capture.raw import LOST_FRAME, RawCapture, RawFrame
from nvsim.capture.read import report_absent_image
from nvsim.capture.types import Alignment
from nvsim.errors import InputError

__all__ = ["Finding", "Report", "check"]
_ORDER = {"error": 0, "warning": 1, "note": 2}


def check(
    path: Path,
    scale: float | None = None,
    camera_height: float | None = None,
    leave_out: str = "",
    alignment: Alignment | None = None,
) -> Report:
    """All findings about the capture at `path` without the frames that `leave_out` names (with commas between them),
    errors first; every image is decoded. An `alignment` that was found already spares a capture without a cloud to be
    aligned again, by its images. Never raises for bad data: a source that cannot be read at all is a report with one
    error."""
    findings = Findings()
    path = Path(path)
    try:
        raw = without(read_raw(path, findings), leave_out, findings)
    except InputError as error:
        findings.error(str(error).rstrip("."), str(path), "nothing can be read")
        return _report(path, "", findings)
    _check_images(raw, findings)
    if any(f.camera_to_world is not None for f in raw.frames):
        _check_geometry(raw, scale, camera_height, alignment, findings)
    return _report(raw.source, raw.format, findings)


def _report(source: Path, kind: str, findings: Findings) -> Report:
    return Report(source, kind, tuple(sorted(findings, key=lambda f: _ORDER[f.severity])))


def _check_images(raw: RawCapture, findings: Findings) -> None:
    """Decodes all images, in threads because the decoder works outside the interpreter's lock."""
    present = [f for f in raw.frames if not report_absent_image(f, findings)]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for frame, fault in zip(present, pool.map(_image_fault, present)):
            if fault is not None:
                findings.error(fault, frame.where, LOST_FRAME)


def _image_fault(frame: RawFrame) -> str | None:
    try:
        decode(frame.image_path, None if frame.lens is None else (frame.lens.width, frame.lens.height))
    except InputError as error:
        return str(error).replace(str(frame.image_path), "the image").rstrip(".")
    return None


def _check_geometry(
    raw: RawCapture,
    scale: float | None,
    camera_height: float | None,
    alignment: Alignment | None,
    findings: Findings,
) -> None:
    floor = None
    if alignment is None or raw.cloud is not None:
        try:
            alignment, floor = align(raw, scale, camera_height, findings)
        except InputError as error:
            findings.error(str(error).rstrip("."), raw.source.name, "the capture cannot be brought to metres")
            return
    if not alignment.scale_known:
        findings.warning(
            "the scale is unknown",
            raw.source.name,
            "the import asks for it: --camera-height METRES above the floor, or --scale METRES per unit",
        )
    capture = apply(raw, alignment)
    if not capture.frames:
        return
    where = {f.name: f.where for f in raw.frames}
    if not check_far_frames(capture, where, findings):
        return  # what else is out of the ordinary follows from that
    check_outliers(capture, where, findings)
    if check_cloud_meets_cameras(capture, findings):
        check_floor_in_view(capture, floor, findings)
