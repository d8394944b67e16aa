"""Check the minimum for a reconstruction: enough frames, images with content, and cameras at several places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawFrame
from nvsim.capture.types import Capture

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
    """Add an error for fewer than four frames, or a warning if the capture has surfaces from a scan or depth images."""
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
            f"these are too few to estimate depth; at least {FEWEST} overlapping frames or a scan are needed",
        )


def check_several_places(capture: Capture, findings: Findings) -> None:
    """Add an error if all cameras are at one place, or a warning if a scan or depth images provide surfaces."""
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
            message, place, "images without parallax give no depth; move the camera between images, or add a scan"
        )


def _has_surfaces(capture: Capture) -> bool:
    return bool(capture.is_measured or capture.scans or capture.depths)
