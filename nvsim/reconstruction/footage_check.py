"""What a path is if it is no capture but a video, and whether the video can be used, before any work starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS, Finding, Findings
from nvsim.capture.formats import resembles_capture
from nvsim.errors import InputError
from nvsim.footage.sources import Footage, find_footage

_LONGEST = 60.0  # seconds until a video has to be open
_SHORT = 5.0  # seconds; a shorter video shows little of a building
_SMALL = 640  # pixels of the longer side; smaller frames show too little texture
_SLOW = 10.0  # frames per second


@dataclass(frozen=True)
class VideoFile:
    """A video that can be decoded.

    name     of the file
    frames   by its header, 0 if unknown
    seconds  by its header, 0 if unknown
    rate     frames per second, 0 if unknown
    width    pixels, as it is seen; `height` likewise
    """

    name: str
    frames: int
    seconds: float
    rate: float
    width: int
    height: int

    @property
    def words(self) -> str:
        """What it is, as one line."""
        length = f"{self.frames} frames, {self.seconds:.1f} s" if self.frames else "an unknown number of frames"
        rate = f", {self.rate:.3g} frames per second" if self.rate else ""
        return f"{self.name}: {length}{rate}, {self.width} x {self.height} pixels"


@dataclass(frozen=True)
class FootageReport:
    """Everything found in a video or in a folder of videos. `files` are those that can be decoded."""

    source: Path
    files: tuple[VideoFile, ...]
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether an import would refuse the video."""
        return any(f.severity == "error" for f in self.findings)


def footage_at(path: Path) -> Footage | None:
    """The video or videos at `path`, to be used in place of a capture: a video file, or a folder with videos in which
    no capture is found. None for everything else, such as a capture with a video beside it."""
    found = find_footage(path)
    if found is None or found.kind != "video" or (path.is_dir() and resembles_capture(path)):
        return None
    return found


def check_footage(footage: Footage, scale_known: bool) -> FootageReport:
    """Opens every video and decodes its first frame. `scale_known`: whether the user gives a scale."""
    from nvsim.processes.child import Child, Limits

    findings, files = Findings(), list[VideoFile]()
    for path in footage.files:
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
        _judge(file, findings)
    if not scale_known and not findings.errors:
        findings.warning(SCALE_ASSUMED, footage.source.name, SCALE_IN_HEIGHTS)
    return FootageReport(footage.source, tuple(files), tuple(findings))


class VideoOpener:
    """Opens videos in a child process, because a damaged file may crash the decoder, which also prints messages."""

    def __call__(self, path: Path) -> VideoFile:
        from nvsim.footage.decoding import video_facts, video_frames

        facts = video_facts(path)
        first = next(iter(video_frames(path)))
        height, width = first.image.shape[:2]
        seconds = facts.frames / facts.rate if facts.rate else 0.0
        return VideoFile(path.name, facts.frames, round(seconds, 2), facts.rate, width, height)


def _judge(file: VideoFile, findings: Findings) -> None:
    if 0 < file.seconds < _SHORT:
        findings.warning(
            "the video is very short", f"{file.name}: {file.seconds:.1f} s", "it shows little of a building"
        )
    if max(file.width, file.height) < _SMALL:
        size = f"{file.name}: {file.width} x {file.height} pixels"
        findings.warning("the video is small", size, "poses may fail for lack of texture; film at 1080p")
    if 0 < file.rate < _SLOW:
        rate = f"{file.name}: {file.rate:.3g} frames per second"
        findings.warning("the video has few frames per second", rate, "poses may fail at turns; film at 30")
