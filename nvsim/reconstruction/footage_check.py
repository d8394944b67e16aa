"""Recognize footage that is given instead of a capture, and check it before any work starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS, Finding, Findings
from nvsim.capture.formats import is_capture, resembles_capture
from nvsim.errors import InputError
from nvsim.footage.position_logs import ODOMETRY, exif_positions, log_files, read_log
from nvsim.footage.sources import Footage, find_footage, is_equirectangular, is_panoramic, says_spherical

_LONGEST = 60.0  # seconds to open a video, at most
_SHORT = 5.0  # seconds; a shorter video shows little of a building
_SMALL = 640  # pixels of the longer side; smaller frames have too little texture
_SMALL_PANORAMA, _SMALL_SIDE = 1280, 400  # pixels of the longer side of a whole panorama, and of a side of a rig
_FEW = 20  # photos
_SLOW = 10.0  # frames per second
_ONLY_LARGE = "they give the scale if the trajectory is several times as large as their error"


@dataclass(frozen=True)
class VideoFile:
    """A video that can be decoded.

    name     name of the file
    frames   number of frames from the header, 0 if unknown
    seconds  duration from the header, 0 if unknown
    rate     frames per second, 0 if unknown
    width    width of the upright image in pixels; `height` is its height
    """

    name: str
    frames: int
    seconds: float
    rate: float
    width: int
    height: int

    @property
    def words(self) -> str:
        """The video in words, as one line."""
        length = f"{self.frames} frames, {self.seconds:.1f} s" if self.frames else "an unknown number of frames"
        rate = f", {self.rate:.3g} frames per second" if self.rate else ""
        return f"{self.name}: {length}{rate}, {self.width} x {self.height} pixels"


@dataclass(frozen=True)
class FootageReport:
    """The result of a check of videos or photos. `files` are the videos that can be decoded."""

    source: Path
    files: tuple[VideoFile, ...]
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether an import would refuse the footage."""
        return any(f.severity == "error" for f in self.findings)


def footage_at(path: Path) -> Footage | None:
    """The video, videos, or photos at `path` that are used instead of a capture.

    This is a video file, or a folder with videos or photos but without a capture. None for all other paths, such as a
    capture with a video next to it."""
    found = find_footage(path)
    return None if found is None or (path.is_dir() and resembles_capture(path)) else found


def check_footage(footage: Footage, scale_known: bool) -> FootageReport:
    """Opens every video, decodes its first frame, and checks the footage. `scale_known`: whether the user gives a
    scale."""
    from nvsim.processes.child import Child, Limits

    findings, files = Findings(), list[VideoFile]()
    for path in footage.files if footage.kind == "video" else ():
        child: Child[Path, VideoFile] = Child(VideoOpener, str(path), "export it as MP4 with H.264 and try again")
        try:
            files.append(child.ask(path, Limits(seconds=_LONGEST)))
        except InputError as error:
            findings.error(str(error).rstrip("."), path.name, "the video cannot be used")
        finally:
            child.release()
    sizes = {(f.width, f.height): f.name for f in files}
    if len(sizes) > 1:
        (a, first), (b, second), *_ = sizes.items()
        findings.error(
            "the videos have several sizes",
            f"{first}: {a[0]} x {a[1]}, {second}: {b[0]} x {b[1]}",
            "give videos of one camera in one orientation",
        )
    for file in files:
        _judge(file, bool(footage.sides), findings)
    if footage.others:
        findings.note(footage.others_text, footage.source.name, "rename them if they are photographs")
    _judge_panoramas(footage, files, findings)
    has_log = _judge_positions(footage, findings)
    if not scale_known and not has_log and not findings.errors:
        findings.warning(SCALE_ASSUMED, footage.source.name, SCALE_IN_HEIGHTS)
    return FootageReport(footage.source, tuple(files), tuple(findings))


def _judge_positions(footage: Footage, findings: Findings) -> bool:
    """Adds findings about recorded camera positions. Returns whether there is an ARKit log, which gives a scale to
    nearly every video. GPS gives a scale to large buildings only."""
    has_log = False
    for path in log_files(footage):
        try:
            count = len(read_log(path).at)
        except InputError as error:
            findings.warning(str(error).rstrip("."), path.name, "it gives no scale")
            continue
        if path.name == ODOMETRY:
            has_log = True
            findings.note(
                "ARKit recorded the positions of the camera",
                f"{path.name}: {count} positions",
                "they give the scale if they fit the poses; --camera-height overrides them",
            )
        elif count:
            findings.note("GPS recorded the positions of the camera", f"{path.name}: {count} positions", _ONLY_LARGE)
    if footage.kind == "photographs":
        count = sum(position is not None for position in exif_positions(footage))
        if count:
            where = f"{footage.source.name}: {count} of {len(footage.files)}"
            findings.note("photographs have GPS positions", where, _ONLY_LARGE)
    return has_log


def _judge_panoramas(footage: Footage, files: list[VideoFile], findings: Findings) -> None:
    """Adds findings about the panoramas if the footage is of a 360 degree camera."""
    name = footage.source.name
    if footage.sides:
        if len({f.frames for f in files}) > 1 or any(f.width != f.height for f in files):
            findings.error(
                "the sides of a 360 degree rig differ in their number of frames, or are not square",
                name,
                "export all sides again together, or rename videos of an ordinary camera",
            )
        else:
            findings.note(
                f"the videos are {footage.sides} sides of a 360 degree rig", name, "their poses are computed together"
            )
        return
    if footage.kind == "video" and not any(is_equirectangular(f.width, f.height) for f in files):
        return
    if footage.kind == "photographs" and not is_panoramic(footage):
        _judge_photographs(footage, findings)
        return
    size = f", {files[0].width} x {files[0].height} pixels" if files else ""
    because = "by their metadata" if says_spherical(footage.files[0]) else "because they are twice as wide as high"
    findings.note(
        f"the images are panoramas of a 360 degree camera{size}, {because}",
        footage.files[0].name,
        "they are cut into four horizontal views of 90 degrees, or into more with --views",
    )


def _judge_photographs(footage: Footage, findings: Findings) -> None:
    name, above = footage.source.name, footage.source.absolute().parent
    if is_capture(above):
        findings.note(
            "the folder above is a capture with camera poses", str(above), "give that folder instead to use its poses"
        )
    if len(footage.files) < _FEW:
        findings.warning("there are few photographs", f"{name}: {len(footage.files)}", "they show little of a building")


class VideoOpener:
    """Opens videos in a child process. A damaged file can crash the decoder, and the decoder prints messages."""

    def __call__(self, path: Path) -> VideoFile:
        from nvsim.footage.decoding import video_facts, video_frames

        facts = video_facts(path)
        first = next(iter(video_frames(path)))
        height, width = first.image.shape[:2]
        seconds = facts.frames / facts.rate if facts.rate else 0.0
        return VideoFile(path.name, facts.frames, round(seconds, 2), facts.rate, width, height)


def _judge(file: VideoFile, is_side: bool, findings: Findings) -> None:
    if 0 < file.seconds < _SHORT:
        findings.warning(
            "the video is very short", f"{file.name}: {file.seconds:.1f} s", "it shows little of a building"
        )
    panoramic = is_side or is_equirectangular(file.width, file.height)
    smallest = _SMALL_SIDE if is_side else _SMALL_PANORAMA if panoramic else _SMALL
    if max(file.width, file.height) < smallest:
        size = f"{file.name}: {file.width} x {file.height} pixels"
        findings.warning("the video is small", size, "poses may fail for lack of texture; film at 1080p or more")
    if 0 < file.rate < _SLOW and not panoramic:
        rate = f"{file.name}: {file.rate:.3g} frames per second"
        findings.warning("the video has few frames per second", rate, "poses may fail at turns; film at 30")
