"""Findings of the data check about the camera poses of a capture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nvsim.capture.alignment import apply
from nvsim.capture.axes import with_axes
from nvsim.capture.check import Report
from nvsim.capture.findings import Finding, Severity
from nvsim.capture.raw import RawFrame
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.poses.agreement import AGREES, Evidence, evidence_of, match_errors
from nvsim.poses.overlap import Overlaps, find_overlaps
from nvsim.poses.pose_mistakes import explain
from nvsim.poses.refinement import are_poses_good, median_epipolar_error

_PAIRS, _FRAMES = 8, 5  # image pairs, and frames in them, below which the check makes no claim
_AGREE = 0.6  # share of the pairs that agree with usable poses
_NONE = 0.35  # share of the pairs that agree by chance with poses that fit no image
_WELL = 0.5  # pixels: poses and lenses with a smaller miss are not examined further
_WRONG = 2 * AGREES  # pixels: miss of a pair with a wrong image or pose
_MOST_WRONG = 0.25  # largest share of the frames that may be named
_STILL = 1.0  # pixels: largest miss of the images of a camera that only rotates
_ANYWAY = "--poses given imports it anyway"
_WHOLE = "the whole capture"


def with_poses(report: Report) -> Report:
    """Adds the findings of `contradictions` to `report`, errors first."""
    found = contradictions(report)
    errors = tuple(f for f in found if f.severity == "error")
    return replace(report, findings=(*errors, *report.findings, *(f for f in found if f not in errors)))


def contradictions(report: Report) -> tuple[Finding, ...]:
    """Findings on poses, lenses, and images that contradict the matches between the images, with the cause if known.
    Empty if the images have too little in common."""
    raw = report.raw
    if raw is None:
        return ()
    usable = [f for f in raw.frames if f.camera_to_world is not None and f.lens is not None]
    if len(usable) < _FRAMES or all(np.array_equal(_place(f), _place(usable[0])) for f in usable):
        return ()
    frames = apply(replace(with_axes(raw, report.axes), cloud=None, scans=(), depths=()), Alignment.identity()).frames
    overlaps = find_overlaps(frames)
    evidence = evidence_of(frames, overlaps.pairs)
    if len(evidence) < _PAIRS or len(np.unique(evidence.frames)) < _FRAMES:
        return ()
    if (found := _without_parallax(report, frames, evidence)) is not None:
        return (found,)
    poses = np.stack([f.camera_to_world for f in frames])
    off = match_errors(poses, evidence, evidence.rays(), evidence.focal())
    share, typical = float(np.mean(off < AGREES)), float(np.median(off))
    if typical >= _WELL:
        read = np.stack([f.camera_to_world for f in usable if f.camera_to_world is not None])
        names = [f.name for f in frames]
        explained = explain(poses, read, usable[0].axes, names, overlaps.order, evidence)
        if explained is not None:
            subject = "" if explained.is_lens else "the poses do not fit the images: "
            message = f"{subject}{explained.message}"
            figures = (
                f"{share:.0%} of {len(off)} image pairs agree with them ({typical:.1f} pixels), "
                f"{explained.share:.0%} after the correction ({explained.miss:.1f} pixels)"
            )
            mend = f"--axes {explained.axes} reads them correctly" if explained.axes else "correct the files"
            severity: Severity = "warning" if share >= _AGREE else "error"
            fix = f"--axes {explained.axes}" if explained.axes else ""
            return (Finding(severity, message, _WHOLE, f"{figures}; {mend}, {_ANYWAY}", fix=fix),)
    if share < _NONE:
        message = (
            f"the poses fit no image: of {len(off)} image pairs that show the same place, {share:.0%} agree with them"
        )
        consequence = (
            "the poses are shuffled, invented, or belong to other images; no depth and no model can be computed; "
            f"correct the files, {_ANYWAY}"
        )
        return (Finding("error", message, _WHOLE, consequence),)
    named = _wrong_frames(frames, overlaps, evidence, off)
    if named:
        return tuple(
            Finding(
                "warning",
                "the image does not show what its pose predicts: it shows another place, or its pose is wrong",
                name,
                "this frame would degrade its submap; --leave-out imports the capture without it",
                (name,),
            )
            for name in named
        )
    if share < _AGREE:
        message = f"of {len(off)} image pairs that show the same place, only {share:.0%} agree with the poses"
        return (Finding("warning", message, _WHOLE, "some poses or lenses are wrong; models become blurred"),)
    return ()


def _place(frame: RawFrame) -> np.ndarray:
    assert frame.camera_to_world is not None
    return frame.camera_to_world[:3, 3]


def _without_parallax(report: Report, frames: tuple[Frame, ...], evidence: Evidence) -> Finding | None:
    """The finding that cameras at different positions show no parallax. Only for captures of unknown scale that have
    neither a LiDAR scan nor depth images."""
    capture = report.capture
    if capture is None or capture.alignment.scale_known or capture.is_measured or capture.depths:
        return None
    poses = np.stack([f.camera_to_world for f in frames])
    first, second = (poses[evidence.frames[:, k], :3, 3] for k in (0, 1))
    apart = np.linalg.norm(first - second, axis=1) > 1e-6 * max(1e-9, float(np.ptp(poses[:, :3, 3], axis=0).max()))
    moved = evidence.select_pairs(apart)
    if len(moved) < _PAIRS:
        return None
    poses[:, :3, 3] = 0
    if np.quantile(match_errors(poses, moved, moved.rays(), moved.focal()), 0.95) > _STILL:
        return None
    return Finding(
        "error",
        "the images show no parallax: the camera only rotated",
        _WHOLE,
        "no depth can be computed from one position; walk with the camera, or add a LiDAR scan",
    )


def _wrong_frames(
    frames: tuple[Frame, ...], overlaps: Overlaps, evidence: Evidence, off: np.ndarray
) -> tuple[str, ...]:
    """Names of the frames that contradict all overlapping frames, while these agree with others."""
    wrong: set[int] = set()
    for _ in range(max(1, int(_MOST_WRONG * len(frames)))):
        left = ~np.isin(evidence.frames, list(wrong)).any(axis=1)
        pairs, bad = evidence.frames[left], off[left] > _WRONG
        counts = np.bincount(pairs.ravel(), minlength=len(frames))
        faults = np.bincount(pairs[bad].ravel(), minlength=len(frames))
        least = np.where(np.isin(np.arange(len(frames)), overlaps.unmatched_frames), 1, 2)
        sure = np.flatnonzero((faults >= least) & (faults >= 0.8 * counts))
        if not len(sure):
            break
        wrong.add(int(sure[np.argmax(faults[sure])]))
    place = {index: k for k, index in enumerate(overlaps.order)}
    poses = np.stack([f.camera_to_world for f in frames])
    for index in overlaps.unmatched_frames:
        around = [overlaps.order[place[index] + step] for step in (-1, 1)]
        steps = [float(np.linalg.norm(poses[index, :3, 3] - poses[a, :3, 3])) for a in around]
        between = float(np.linalg.norm(poses[around[0], :3, 3] - poses[around[1], :3, 3]))
        looks = [float(poses[index, :3, 2] @ poses[a, :3, 2]) for a in around]
        if max(steps) <= 1.5 * between and min(looks) > np.cos(np.radians(25)):
            wrong.add(index)
    return tuple(frames[i].name for i in sorted(wrong))


def find_pose_contradiction(capture: Capture) -> Finding | None:
    """The finding that the poses contradict the images, and its consequence. None if the poses agree with the images or
    cannot be tested."""
    if not capture.alignment.scale_known or are_poses_good(missed := median_epipolar_error(capture.frames)):
        return None
    message = f"the poses miss matched features by {missed:.2f} pixels; exact poses miss them by 0.1 pixels"
    if capture.is_scanned:
        consequence = "models become blurred; --poses refined adjusts the poses to the images"
        return Finding("warning", message, "the whole capture", consequence)
    consequence = "the poses are adjusted when it is imported; --poses given keeps them"
    return Finding("note", message, "the whole capture", consequence)
