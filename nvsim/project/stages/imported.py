"""Imports a source as the project's capture: reads the source, and commits capture.json and the point cloud."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np

from nvsim.capture.axes import CHOICES
from nvsim.capture.findings import ASSUMED_HEIGHT, SCALE_ASSUMED, SCALE_IN_HEIGHTS, Finding, Findings
from nvsim.capture.types import Alignment, Capture, DepthFile, Frame
from nvsim.errors import InputError, value_text
from nvsim.events import Done, Listener, Log, Progress, Warning, ignore_event
from nvsim.files.reading import reading
from nvsim.plain_text import capitalized
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig, PoseUse
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.project import Project
from nvsim.project.work import StageName, missing_result_error

if TYPE_CHECKING:
    from nvsim.reconstruction.report import PosesReport

STAGE: StageName = "import"


def run(
    project: Project,
    source: Path,
    config: CaptureConfig,
    listen: Listener = ignore_event,
    alignment: Alignment | None = None,
) -> Capture:
    """Reads and checks the capture of `source`, stores it in the project, and returns it. If `alignment` is given, the
    capture is in its frame. A splat file is imported as a capture without images.

    If `source` is a video, its poses are computed first. Without a given scale, the scale of recorded positions is
    used. If there is none, a camera height is assumed for a video, and `alignment.scale_known` is False.

    Raises InputError if the check refuses the capture, or the scale of a capture other than a video is unknown.
    """
    from nvsim.capture.check import check
    from nvsim.capture.dense_frames import without_near_duplicates
    from nvsim.capture.excluded_frames import expand_list
    from nvsim.capture.read import read
    from nvsim.capture.store import fingerprint, save_capture
    from nvsim.footage.cut_options import cut_options
    from nvsim.poses.pose_checks import contradictions, with_poses
    from nvsim.project.stages import imported_splats, posed
    from nvsim.reconstruction.pose_networks import PoseNetworks
    from nvsim.reconstruction.report import report_beside

    if imported_splats.is_splats(source):
        return imported_splats.run(project, source, config, listen)
    started = time.monotonic()
    networks = PoseNetworks(config.features, config.people)
    source = posed.run(project, source, listen, config.model, cut_options(config.views, config.mask), networks)
    config = dataclasses.replace(config, views=None, mask="", features="", people="")  # stored with the poses
    listen(Progress(STAGE, 0, 1, str(source)))
    images = str(Path(config.images).expanduser().absolute()) if config.images else ""
    config = dataclasses.replace(config, leave_out=expand_list(config.leave_out), images=images)
    config = _with_scale(config, source)
    poses_report = report_beside(source.expanduser())
    is_given = config.scale is not None or config.camera_height is not None
    if poses_report is not None and alignment is None:
        scale, height, measured = poses_report.measured_options(source, config.model)
        # The window passes the scale that an earlier import measured and stored.
        is_given = is_given and (config.scale, config.camera_height) != (scale, height)
        if not is_given:
            _tell_measured_scale(poses_report, source, config.model, listen)
            config, alignment = dataclasses.replace(config, scale=scale, camera_height=height), measured
        if config.scale is None and config.camera_height is None:
            config = _with_last_height(config, project, source, listen)
        assumed = config.scale is None and config.camera_height is None
    else:
        assumed = alignment is not None and not alignment.scale_known
    if assumed:
        config = dataclasses.replace(config, camera_height=ASSUMED_HEIGHT)
    scale = config.scale
    if scale is None and poses_report is not None:
        scale = poses_report.scale_for(config.camera_height, source, config.model)
    capture = read(
        source,
        scale=scale,
        camera_height=config.camera_height,
        alignment=alignment,
        leave_out=config.leave_out,
        images=config.images,
        axes=config.axes,
        model=config.model,
    )
    if assumed:
        capture = dataclasses.replace(capture, alignment=dataclasses.replace(capture.alignment, scale_known=False))
        listen(Warning(f"{capitalized(SCALE_ASSUMED)}: {SCALE_IN_HEIGHTS}.", STAGE))
    if is_given and poses_report is not None:
        contradiction = poses_report.scale_contradiction(capture.alignment.scale, source, config.model)
        if contradiction:
            listen(Warning(contradiction, STAGE))
    key = ledger.key_of(STAGE, fingerprint(capture), str(capture.source), config.key)
    if ledger.is_current(project, STAGE, key):
        with contextlib.suppress(InputError):  # a damaged capture is stored again
            stored = project.capture()
            if stored is not None:
                listen(Log("The capture is unchanged.", STAGE))
                return stored
    how = scale, config.camera_height, config.leave_out, capture.alignment, config.images
    report = check(source, *how, config.axes, config.model)
    contradicted: tuple[Finding, ...] = ()
    if config.poses == "given":  # the user confirms them
        contradicted = contradictions(report)
    else:
        report = with_poses(report)
    for finding in (*report.findings, *contradicted):
        if finding.severity == "warning" or finding in contradicted:
            listen(Warning(f"{finding.message} ({finding.where}): {finding.consequence}", STAGE))
    if report.refused:
        first = next(f for f in report.findings if f.severity == "error")
        raise InputError(
            f"{source} cannot be used: {first.message} ({value_text(first.where)}); "
            f"{f'{first.fix} corrects it; ' if first.fix else ''}`nvsim check {source}` lists all findings."
        )
    if report.capture is not None:
        capture = _without_faulty(capture, report.capture)
    if not capture.alignment.scale_known and not assumed:
        raise InputError(
            f"{source} has no metric scale; give the height of the cameras above the floor (--camera-height METERS) or "
            "the length of a unit (--scale METERS)."
        )
    dense = len(capture.frames)
    capture = without_near_duplicates(capture)
    if len(capture.frames) < dense:
        text = f"{len(capture.frames)} of {dense} frames are used; the others are nearly equal to them and less sharp."
        listen(Log(text, STAGE))
    capture, adjusted = _select_poses(capture, config, listen)
    report_replaced_result(project, STAGE, listen)
    with contextlib.suppress(InputError):  # an unreadable capture is imported again
        project.fix_cut()
    ledger.begin_part(project, STAGE, key)
    save_capture(capture, project.making(project.stage_results().made_at(STAGE)).layout.imported)
    points = 0 if capture.cloud is None else len(capture.cloud.points)
    summary = {"frames": len(capture.frames), "points": points, "format": capture.format, **adjusted}
    if poses_report is not None:
        summary["video"] = poses_report.source
    understood = json.dumps(dataclasses.asdict(config))
    seconds = time.monotonic() - started
    ledger.finish(project, STAGE, seconds, summary, settings=understood)
    listen(Progress(STAGE, 1, 1))
    words = [f"{len(capture.frames)} frames", f"{points} points"]
    masks = sum(f.mask is not None for f in capture.frames)
    more = [(len(capture.depths), "depth images"), (masks, "masks")]
    words += [f"{count} {what}" for count, what in more if count]
    listed = f"{', '.join(words[:-1])} and {words[-1]}"
    listen(Done(STAGE, f"{listed}; format: {capture.format}", summary))
    return capture


def _with_scale(config: CaptureConfig, source: Path) -> CaptureConfig:
    """`config` with the scale from its known length. Raises InputError if the known length does not fit this capture,
    or the scale is also given."""
    from nvsim.capture.alignment import scale_from_length
    from nvsim.capture.read import read_usable

    if not config.known_length:
        return config
    if config.scale is not None:
        raise InputError("--scale and --known-length both set the scale; leave out one of them.")
    raw = read_usable(source, config.leave_out, config.images, Findings(), config.model)
    return dataclasses.replace(config, scale=scale_from_length(config.known_length, raw), known_length="")


def _with_last_height(config: CaptureConfig, project: Project, source: Path, listen: Listener) -> CaptureConfig:
    """`config` with the camera height that the last import of this video was given, if there was one. A scale in meters
    per unit is not kept, because the unit changes if the poses are computed again."""
    with contextlib.suppress(InputError):  # a damaged capture is imported again
        stored, last = project.capture(), capture_config(project)
        same = stored is not None and stored.source == source and last.model == config.model
        if stored is not None and same and stored.alignment.scale_known and last.camera_height is not None:
            listen(Log(f"The camera height of the last import, {last.camera_height:g} m, is kept.", STAGE))
            return dataclasses.replace(config, camera_height=last.camera_height)
    return config


def _tell_measured_scale(report: PosesReport, source: Path, model: str, listen: Listener) -> None:
    measured = report.measured_for(source, model)
    if measured is not None:
        words = f"Measured scale: {measured.words(report.is_upright(source, model))}."
        listen(Warning(words, STAGE) if measured.refused else Log(words, STAGE))


def _without_faulty(capture: Capture, checked: Capture) -> Capture:
    """`capture` without the masks and depth images that the check refused."""
    masks, depths = {f.name: f.mask for f in checked.frames}, {d.path for d in checked.depths}
    frames = tuple(dataclasses.replace(f, mask=masks.get(f.name, f.mask)) for f in capture.frames)
    kept = tuple(d for d in capture.depths if d.path in depths)
    return dataclasses.replace(capture, frames=frames, depths=kept)


def _select_poses(capture: Capture, config: CaptureConfig, listen: Listener) -> tuple[Capture, dict[str, float]]:
    """The capture with the poses that `config` selects, and the figures of the adjustment for the summary."""
    from nvsim.poses.refinement import are_poses_good, median_epipolar_error, refine

    # A scan, and depth that belongs to no image, were measured with the given poses and would not move with them.
    is_fixed = capture.is_scanned or bool(capture.scans) or any(not depth.frame for depth in capture.depths)
    if config.poses == "given" or (
        config.poses == "auto" and (is_fixed or are_poses_good(median_epipolar_error(capture.frames)))
    ):
        return capture, {}
    found = refine(capture.frames, lambda done, of: listen(Progress(STAGE, done, of, "matches between images")))
    if found is None:
        listen(Log("The poses are unchanged, because no other poses agree better with the images.", STAGE))
        return capture, {}
    text = (
        f"The poses were adjusted. Matches between images are {found.before:.2f} pixels off with the given poses, and "
        f"{found.after:.2f} with the adjusted ones; cameras moved by {1000 * found.meters:.0f} mm and "
        f"{found.degrees:.2f} degrees (medians; --poses given keeps the given poses)."
    )
    listen(Log(text, STAGE))
    figures = {"before_px": found.before, "after_px": found.after, "metres": found.meters, "degrees": found.degrees}
    rounded = {f"poses_{name}": round(value, 4) for name, value in figures.items()}
    depths = _depths_at_adjusted_poses(capture.depths, capture.frames, found.frames)
    return dataclasses.replace(capture, frames=found.frames, depths=depths), rounded


def _depths_at_adjusted_poses(
    depths: Sequence[DepthFile], before: Sequence[Frame], after: Sequence[Frame]
) -> tuple[DepthFile, ...]:
    """The depth images at the adjusted poses of their frames."""
    moves = {a.name: b.camera_to_world @ np.linalg.inv(a.camera_to_world) for a, b in zip(before, after, strict=True)}
    same = np.eye(4)
    return tuple(dataclasses.replace(d, camera_to_world=moves.get(d.frame, same) @ d.camera_to_world) for d in depths)


def capture_config(project: Project) -> CaptureConfig:
    """The options of the import of the project's capture. Raises InputError if the stored options are invalid."""
    found = project.stage_results().part(STAGE)
    if found is None or not found.settings:
        return CaptureConfig()
    with reading(project.layout.database, "a database that says how the capture was imported", "import it again"):
        values = json.loads(found.settings)
        config = CaptureConfig(**values)
        for length in (config.scale, config.camera_height):
            if length is not None and not (type(length) in (int, float) and 0 < length < 1e9):
                raise ValueError(f"{length!r} meters")
        if config.poses not in get_args(PoseUse):
            raise ValueError(f"poses {config.poses!r}")
        if config.axes not in CHOICES:
            raise ValueError(f"axes {config.axes!r}")
        if type(config.hold_out) is not int or not 0 <= config.hold_out < 1 << 31:
            raise ValueError(f"every {config.hold_out!r}th frame is held out")
    return config


def capture_key(project: Project) -> str:
    """The key that all later stages depend on. Raises InputError if nothing is imported."""
    found = ledger.record(project, STAGE)
    if found is None:
        raise missing_result_error(project.layout.root, "import")
    return found.key
