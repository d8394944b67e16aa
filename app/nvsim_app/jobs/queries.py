"""Queries to the command line, in side processes: a command that answers with one line of JSON, and the check of a
capture, which decodes every image."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from nvsim.capture.axes import CHOICES
from nvsim.capture.findings import (
    IMAGE_AMBIGUOUS,
    IMAGE_MISSING,
    OTHER_MODELS,
    SCALE_ASSUMED,
    SCALE_UNKNOWN,
    Finding,
    FindingGroup,
    grouped,
)
from nvsim.capture.summary import Summary
from nvsim.events import Failed, from_json
from nvsim.files.records import record_of
from nvsim.reconstruction.footage_check import VideoFile
from nvsim_app.processes.child import ChildProgram
from nvsim_app.processes.serving import CommandOutput, EndMessage, run_command
from nvsim_app.processes.side_process import SideProcess


class CommandQuery(QObject):
    """Runs a command and emits its answer: finished(answer), or failed(str) with a sentence, for the last `ask` only.

    read  parses a line of the output; raises ValueError if the line is not an answer
    name  name of the query, used as the subject of error sentences
    """

    finished = Signal(object)
    failed = Signal(str)

    def __init__(self, read: Callable[[str], object], name: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._read = read
        self._no_answer = f"{name} ended without an answer; try again."
        cannot = f"{name} could not be started with {sys.executable}"
        self._process = SideProcess(ChildProgram(run_command, name, cannot, "reinstall NVSim", self._no_answer), self)
        self._process.ended.connect(self._on_end)

    @property
    def running(self) -> bool:
        return self._process.running

    def ask(self, words: Sequence[str]) -> None:
        """Runs `nvsim WORDS` in the background and stops a running command."""
        self._process.open(tuple(words))

    def stop(self) -> None:
        """Ends the running command without emitting a signal."""
        self._process.close()

    def _on_end(self, end: EndMessage) -> None:
        if not isinstance(end.value, CommandOutput):
            self.failed.emit(end.sentence)
            return
        for line in reversed(end.value.lines):
            try:
                answer = self._read(line)
            except ValueError:
                continue
            self.finished.emit(answer)
            return
        said = end.value.messages[-1] if end.value.messages else self._no_answer
        self.failed.emit(_failure(end.value.lines) or said)


def _failure(lines: Sequence[str]) -> str:
    """The message of the last Failed event, "" if there is none."""
    for line in reversed(lines):
        try:
            event = from_json(line)
        except ValueError:
            continue
        if isinstance(event, Failed):
            return event.message
    return ""


@dataclass(frozen=True)
class CheckResult:
    """The result of a data check.

    refused   whether an import would refuse the capture
    kinds     the findings, the worst first
    summary   the contents of the capture, None if they cannot be read
    videos    given instead of a summary if the capture consists of videos
    networks  whether networks can find features or mask people: the capture is a video or photographs without poses,
              and not of a 360 degree camera
    """

    refused: bool
    kinds: tuple[FindingGroup, ...]
    summary: Summary | None = None
    videos: tuple[VideoFile, ...] = ()
    networks: bool = False

    @property
    def needs_scale(self) -> bool:
        """Whether the scale is unknown and must be given."""
        return any(k.message == SCALE_UNKNOWN for k in self.kinds)

    @property
    def accepts_scale(self) -> bool:
        """Whether the scale may be given. Without it, lengths are in camera heights."""
        return any(k.message == SCALE_ASSUMED for k in self.kinds)

    @property
    def needs_images(self) -> bool:
        """Whether images are not at the paths that the capture gives."""
        return any(k.message in (IMAGE_MISSING, IMAGE_AMBIGUOUS) for k in self.kinds)

    @property
    def has_models(self) -> bool:
        """Whether there are several COLMAP models to choose from."""
        return any(k.message == OTHER_MODELS for k in self.kinds)

    @property
    def bad_frames(self) -> tuple[str, ...]:
        """Names of the frames with errors."""
        return tuple(dict.fromkeys(name for k in self.kinds if k.severity == "error" for name in k.frames))

    @property
    def axes(self) -> str:
        """The convention of the camera axes that fits the images, "" if none was found."""
        fixes = [k.fix.split() for k in self.kinds if k.fix.startswith("--axes ")]
        return next((words[1] for words in fixes if len(words) == 2 and words[1] in CHOICES), "")

    @property
    def is_fixable(self) -> bool:
        """Whether the errors can be fixed: by leaving out frames, by naming the folder of the images, or by another
        axis convention."""
        left = self.summary is not None and len(self.bad_frames) < self.summary.images
        return self.needs_images or bool(self.axes) or (left and bool(self.bad_frames))

    @property
    def sentence(self) -> str:
        """The result as a sentence."""
        if self.videos:
            return self._about_videos
        if self.refused:
            return "This capture cannot be used as it is."
        if self.needs_scale:
            return "The scale of the capture is unknown; enter the height of the cameras above the floor."
        warnings = sum(k.severity == "warning" for k in self.kinds)
        if warnings:
            return f"The capture can be used; {warnings} problem{'s' if warnings > 1 else ''} may reduce quality."
        return "The capture has no problems."

    @property
    def _about_videos(self) -> str:
        what = "This video" if len(self.videos) == 1 else f"These {len(self.videos)} videos"
        if self.refused:
            return f"{what} cannot be used."
        scale = " Without the camera height, lengths are in camera heights." if self.accepts_scale else ""
        return f"{what} can be used. The import computes the camera poses first, which takes some minutes.{scale}"


def result_of(text: str) -> CheckResult:
    """Parses the output of `nvsim check --json`. Raises ValueError if it is not the result of a data check."""
    try:
        data = json.loads(text)
        kinds = grouped([record_of(Finding, finding) for finding in data["findings"]])
        summary = data.get("summary")
        videos = tuple(record_of(VideoFile, video) for video in data.get("videos", ()))
        networks = not data.get("panoramic", True)
        read = None if summary is None else record_of(Summary, summary)
        return CheckResult(bool(data["refused"]), kinds, read, videos, networks)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f"not a data check: {text[:80]!r}") from error


class CaptureCheck(CommandQuery):
    """Runs the data check. finished(CheckResult) or failed(str) is emitted for the last `start` only."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(result_of, "The data check", parent)

    def start(
        self,
        capture: Path,
        scale: float | None = None,
        camera_height: float | None = None,
        leave_out: str = "",
        images: str = "",
        axes: str = "",
        model: str = "",
    ) -> None:
        """Checks a capture in the background and stops a running check. The options are those of `nvsim check`."""
        words = ["check", str(capture), "--json"]
        options = {"scale": scale, "camera-height": camera_height, "leave-out": leave_out, "images": images}
        for name, value in (options | {"axes": axes, "model": model}).items():
            words += [f"--{name}", str(value)] if value not in (None, "") else []
        self.ask(words)
