"""Commands on captures: check one, compute the poses of one, import one into a project."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nvsim.capture import formats
from nvsim.capture.axes import Axes
from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS, SCALE_UNKNOWN, Finding, grouped
from nvsim.cli.arguments import Inline
from nvsim.cli.console import event_listener, with_command_options
from nvsim.cli.session import project_job
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.events import Log
from nvsim.plain_text import count_text
from nvsim.project.config import CaptureConfig

if TYPE_CHECKING:
    from nvsim.capture.summary import Summary
    from nvsim.footage.sources import Footage
    from nvsim.reconstruction.report import PosesReport


CapturePath = Annotated[
    Path,
    tyro.conf.Positional,
    tyro.conf.arg(
        help=f"A folder or file: {formats.names()}; or a video, or a folder of videos or photographs; or a splat file "
        "or a .splats list of them."
    ),
]
_PLACES = 3
_WHERE_FROM = {
    "lidar": "of a LiDAR scan",
    "sfm": "of image features",
    "images": "from the depth of the images",
    "depth": "of depth images",
}


@dataclass(frozen=True)
class Check:
    """List the content of a capture and its problems before any work starts: every finding with its place, severity and
    consequence."""

    capture: CapturePath
    scale: float | None = None
    """Meters per unit of the capture, if the capture does not define it."""
    camera_height: float | None = None
    """Height of the cameras above the floor in meters."""
    leave_out: str = ""
    """Names of frames to skip, separated by commas, or @FILE with one name per line."""
    images: str = ""
    """Folder of the images, if they are not where the capture says."""
    axes: Axes = "auto"
    """Convention of the camera axes in the files; auto is the default of the format. With -inverse, poses are inverted
    compared with the format."""
    model: str = ""
    """The COLMAP model to read if there are several, by its folder (1, or sparse/1). Default: the one with most
    images."""
    bad_frames: Path | None = None
    """Write the names of unusable frames into this file, for --leave-out @FILE."""
    places: bool = False
    """Name every place of a finding instead of the first three."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.capture.check import check
        from nvsim.capture.excluded_frames import expand_list, write_names
        from nvsim.poses.pose_checks import find_pose_contradiction, with_poses
        from nvsim.reconstruction.footage_check import footage_at
        from nvsim.reconstruction.posed_panoramas import find_posed_panoramas
        from nvsim.reconstruction.report import report_beside

        footage = footage_at(self.capture.expanduser())
        if footage is not None:
            return _check_video(footage, self)
        panoramas = find_posed_panoramas(self.capture.expanduser())
        if panoramas is not None:
            return _say_posed_panoramas(panoramas, self)
        leave_out = expand_list(self.leave_out)
        poses = report_beside(self.capture.expanduser())
        scale, height, alignment = self.scale, self.camera_height, None
        is_given = scale is not None or height is not None
        if poses is not None and not is_given:
            scale, height, alignment = poses.measured_options(self.capture, self.model)
        if scale is None and poses is not None:
            scale = poses.scale_for(height, self.capture, self.model)
        given = scale, height, leave_out, alignment
        report = with_poses(check(self.capture, *given, self.images, self.axes, self.model))
        if poses is not None:
            used = None if report.capture is None or not is_given else report.capture.alignment.scale
            measured = _of_measured_scale(poses, used, self)
            report = dataclasses.replace(report, findings=(*map(_of_footage, report.findings), *measured))
        if (
            not report.refused
            and report.capture is not None
            and (found := find_pose_contradiction(report.capture)) is not None
        ):
            report = dataclasses.replace(report, findings=(*report.findings, found))
        if self.bad_frames is not None:
            write_names(report.bad_frames, self.bad_frames)
        if self.json:
            findings = [dataclasses.asdict(f) for f in report.findings]
            summary = None if report.summary is None else dataclasses.asdict(report.summary)
            print_lines(as_json({"refused": report.refused, "findings": findings, "summary": summary}))
            return 2 if report.refused else 0
        if report.summary is not None:
            print_lines(describe_capture(report.summary))
        _say_findings(report.findings, self.places)
        print_lines("The capture cannot be used as it is." if report.refused else "The capture can be used.")
        bad = len(report.bad_frames)
        if bad and report.summary is not None and bad < report.summary.images:
            if self.bad_frames is not None:
                print_lines(f"Skip the {bad} frames with errors with --leave-out @{self.bad_frames}.")
            else:
                print_lines(f"Errors affect {bad} frames: --bad-frames FILE lists them, --leave-out @FILE skips them.")
        return 2 if report.refused else 0


def _of_footage(finding: Finding) -> Finding:
    """The finding about an unknown scale, reworded for poses of a video."""
    if finding.message != SCALE_UNKNOWN:
        return finding
    return dataclasses.replace(finding, message=SCALE_ASSUMED, consequence=SCALE_IN_HEIGHTS)


def _of_measured_scale(poses: PosesReport, used: float | None, arguments: Check) -> list[Finding]:
    """Findings about the scale from recorded positions. `used`: meters per unit that the user gave, None without."""
    source, model = arguments.capture, arguments.model
    measured = poses.measured_for(source, model)
    if measured is None:
        return []
    if used is not None:
        contradiction = poses.scale_contradiction(used, source, model).rstrip(".")
        wrong = "lengths may be wrong by that much"
        return [Finding("warning", contradiction, source.name, wrong)] if contradiction else []
    words = measured.words(poses.is_upright(source, model))
    if measured.refused:
        return [Finding("note", "recorded positions give no scale", source.name, words)]
    return [Finding("note", "the scale is measured", source.name, f"{words}; --camera-height METERS overrides it")]


def _say_findings(findings: Sequence[Finding], all_places: bool) -> None:
    for kind in grouped(findings):  # lines instead of a table, because a table could cut places short
        print_lines(with_command_options(kind.sentence(None if all_places else _PLACES)))


def _say_posed_panoramas(listed: Path, arguments: Check) -> int:
    message = "the images are panoramas of a 360 degree camera with poses"
    found = Finding("note", message, listed.name, "they are cut into perspective views before the import")
    if arguments.json:
        print_lines(as_json({"refused": False, "findings": [dataclasses.asdict(found)], "summary": None}))
        return 0
    _say_findings([found], arguments.places)
    print_lines(f"Continue with `nvsim run {arguments.capture} --project NAME.nvsim`.")
    print_lines(f"`nvsim poses {arguments.capture} --out FOLDER` makes a capture that can be checked.")
    return 0


def _check_video(footage: Footage, arguments: Check) -> int:
    from nvsim.footage.sources import is_panoramic
    from nvsim.reconstruction.footage_check import check_footage

    known = arguments.scale is not None or arguments.camera_height is not None
    report = check_footage(footage, known)
    code = 2 if report.refused else 0
    if arguments.json:
        findings = [dataclasses.asdict(f) for f in report.findings]
        videos = [dataclasses.asdict(f) for f in report.files]
        panoramic = not report.refused and is_panoramic(footage)
        data = {"refused": report.refused, "findings": findings, "summary": None, "videos": videos}
        print_lines(as_json({**data, "panoramic": panoramic}))
        return code
    for file in report.files:
        print_lines(f"{file.words}.")
    _say_findings(report.findings, arguments.places)
    if report.refused:
        print_lines(
            "The video cannot be used as it is." if footage.kind == "video" else "They cannot be used as they are."
        )
    else:
        if footage.kind == "video":
            print_lines(
                "This is a video, not a capture; it can be decoded. NVSim computes its camera poses before the import."
            )
        else:
            print_lines(
                f"These are {footage.description} without poses. NVSim computes their camera poses before the import."
            )
        height = "" if arguments.camera_height is None else f"{arguments.camera_height:g}"
        scale = f" --camera-height {height or '1.4'}" if arguments.scale is None else f" --scale {arguments.scale:g}"
        if not known and all(f.message != SCALE_ASSUMED for f in report.findings):
            scale = ""  # recorded positions give it
        print_lines(f"Continue with `nvsim run {footage.source} --project NAME.nvsim{scale}`.")
    return code


def describe_capture(summary: Summary) -> str:
    """The content of a capture in one line."""
    sizes = ", ".join(f"{width} x {height}" for width, height, _ in summary.sizes[:3])
    more = f" and {len(summary.sizes) - 3} more" if len(summary.sizes) > 3 else ""
    unit = "m" if summary.scale_known else "units"
    parts = [f"{count_text(summary.images, 'image')} of {count_text(summary.cameras, 'camera')}"]
    parts += [f"{sizes}{more} pixels"] if sizes else []
    parts += [f"{summary.length:.4g} {unit} over {summary.width:.3g} x {summary.depth:.3g}"] if summary.paths else []
    cloud = [] if summary.depth_images else ["no point cloud"]
    cloud = [f"{summary.points} points {_WHERE_FROM[summary.cloud]}"] if summary.points else cloud
    more_files = [(summary.depth_images, "depth image"), (summary.masks, "mask")]
    parts += [count_text(count, what) for count, what in more_files if count]
    return f"{'; '.join([*parts, *cloud])}."


@dataclass(frozen=True)
class Poses:
    """Compute camera poses for a video or photographs, so that they become a capture: images, focal length, poses,
    points.

    The output folder is an ordinary COLMAP capture. `nvsim run FOLDER --project PROJECT --camera-height 1.4` continues
    with it. `nvsim run VIDEO` does both. The unit of the poses is unknown, so the height of the camera above the floor
    sets the scale. If there is an ARKit or GPS log next to the images, the log sets the scale.
    """

    source: Annotated[Path, tyro.conf.Positional]
    """A video (MP4, MOV, MKV, WebM), a folder of videos of one building by one camera, or a folder of photographs.
    Images of a 360 degree camera are equirectangular (twice as wide as high), or its sides: side0.mp4, side1.mp4, ...
    A transforms.json of posed panoramas (camera_model EQUIRECTANGULAR) is cut into perspective views."""
    out: Path
    """The folder for frames, poses and report. An interrupted run continues there."""
    views: int | None = None
    """Number of views into which panoramas of a 360 degree camera are cut: 4 level ones, 8 with four more that look 45
    degrees down, or 12 with four more that look 45 degrees up. Default: the number of the previous run, else 4."""
    mask: str = ""
    """A PNG file with the proportions of the panoramas, whose black pixels are ignored. It replaces the mask of the
    camera carrier that NVSim computes."""
    features: str = ""
    """Installed network that finds and matches keypoints (see nvsim models). It is compared with SIFT on a sample of
    pairs, and used if it is better. none: SIFT. Default: that of the previous run, else none."""
    people: str = ""
    """Installed network that recognizes people (see nvsim models). People are masked: they have no features and tracked
    points. none: no masks. Default: that of the previous run, else none."""
    json: bool = False
    """Print events and the result as JSON."""

    def run(self) -> int:
        from nvsim.footage.cut_options import cut_options
        from nvsim.reconstruction.computing import compute_poses
        from nvsim.reconstruction.pose_networks import PoseNetworks
        from nvsim.reconstruction.posed_panoramas import cut_posed_panoramas, find_posed_panoramas
        from nvsim.reconstruction.report import rows

        out, source = self.out.expanduser(), self.source.expanduser()
        panoramas = find_posed_panoramas(source)
        options, networks = cut_options(self.views, self.mask), PoseNetworks(self.features, self.people)
        with event_listener(self.json) as listen:
            if panoramas is not None:
                networks.refuse_for_poses(source)
                cut_posed_panoramas(panoramas, out, listen, options)
                listen(Log(f"Continue with `nvsim run {out} --project NAME.nvsim`.", "poses"))
                return 0
            report = compute_poses(source, out, listen, options=options, networks=networks)
            for name, words in rows(report).items():
                listen(Log(f"{name}: {words}", "poses"))
            is_measured = any(not measured.refused for measured in report.measured[:1])
            scale = "" if is_measured else " --camera-height METERS"
            listen(Log(f"Continue with `nvsim run {out} --project NAME.nvsim{scale}`.", "poses"))
        return 0


@dataclass(frozen=True)
class Import:
    """Read a capture into a project: frames, cameras, poses and point cloud, rotated upright. Images are not copied."""

    capture: CapturePath
    project: Path
    """The project folder to create or to write to."""
    add: bool = False
    """Keep the project's captures and add this one, which must show the same building in the same frame and unit."""
    json: bool = False
    """Print events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)

    def run(self) -> int:
        """Runs the command. Raises InputError if options contradict --add."""
        from nvsim.project.stages import added_captures, imported

        with project_job(self.project, "import", self.json, create=not self.add) as (project, listen):
            if self.add:
                leave_out = self.understood.leave_out
                if self.understood != CaptureConfig(leave_out=leave_out):
                    raise InputError(
                        "An added capture has the scale and the held-out frames of the first; do not give --scale, "
                        "--camera-height, --known-length, --hold-out, --images, --axes, --poses, --views, --mask, "
                        "--features or --people. Instead of --model, name the model's folder."
                    )
                added_captures.run(project, self.capture, listen, leave_out)
            else:
                imported.run(project, self.capture, self.understood, listen)
        return 0
