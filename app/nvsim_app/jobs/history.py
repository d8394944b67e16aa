"""The collected events of a job, for tables and plots, and its output folder. Does not use Qt."""

from __future__ import annotations

import os
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import value_of_flag
from nvsim.events import Done, Event, Failed, Log, Metric, Preview, Progress, Warning, Worker
from nvsim.files.opening import is_folder
from nvsim.project.jobs.joblist import Job
from nvsim.project.work import EXPORTS

WINDOW = 30.0  # seconds over which the rate is averaged
MOST_POINTS = 2000  # maximum number of points of a series; beyond it, every second point is removed
MOST_LINES = 2000  # maximum number of stored log lines
MOST_WORKERS = 500  # maximum number of stored workers; each process of a cluster has its own name


@dataclass
class MetricSeries:
    """A metric over the training steps, thinned if it is long."""

    steps: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    _stride: int = 1
    _seen: int = 0

    def add(self, step: float, value: float) -> None:
        if self.steps and step <= self.steps[-1]:  # training resumed from a checkpoint: drop later values
            keep = next(i for i, s in enumerate(self.steps) if s >= step)
            del self.steps[keep:], self.values[keep:]
        self._seen += 1
        if self._seen % self._stride:
            return
        self.steps.append(step)
        self.values.append(value)
        if len(self.steps) > MOST_POINTS:
            del self.steps[::2], self.values[::2]
            self._stride *= 2


def image_key(submap: int) -> str:
    """The key in `JobReport.images` of the images of a submap."""
    return f"submap {submap}"


@dataclass(frozen=True)
class LogLine:
    """A line of the log: time in seconds since the epoch, kind ("log", "warning", "error", or "done"), one sentence."""

    at: float
    kind: str
    text: str


class JobReport:
    """The collected state of a job. `receive` adds an event."""

    def __init__(self) -> None:
        self.progress: Progress | None = None
        self.series: dict[str, dict[int, MetricSeries]] = {}  # metric -> submap -> series
        self.images: dict[str, dict[int, Preview]] = {}  # subject -> step -> image; the newest is last
        self.lines: deque[LogLine] = deque(maxlen=MOST_LINES)
        self.line_count = 0  # number of lines so far
        self.results: dict[str, dict[str, object]] = {}  # stage -> results of its last run
        self.failure = ""
        self.workers: dict[str, tuple[float, Worker]] = {}  # name -> time and content of its last event
        self._marks: deque[tuple[float, int]] = deque()

    def receive(self, at: float, event: Event) -> None:
        if isinstance(event, Progress):
            self._on_progress(at, event)
        elif isinstance(event, Metric):
            self.series.setdefault(event.name, {}).setdefault(event.submap, MetricSeries()).add(event.step, event.value)
        elif isinstance(event, Preview):
            self._on_image(event)
        elif isinstance(event, Done):
            self.results[event.stage] = event.results
            self._add_line(at, "done", event.stage, event.summary)
        elif isinstance(event, Failed):
            self.failure = event.message
            self._add_line(at, "error", event.stage, event.message)
        elif isinstance(event, Warning):
            self._add_line(at, "warning", event.stage, event.text)
        elif isinstance(event, Worker):
            self.workers.pop(event.name, None)  # moves the worker to the end, so that the oldest is removed first
            self.workers[event.name] = (at, event)
            if len(self.workers) > MOST_WORKERS:
                del self.workers[next(iter(self.workers))]
        elif isinstance(event, Log):
            if not event.stage:  # the job starts or restarts
                self._marks.clear()
                self.failure = ""
                self.workers.clear()
            self._add_line(at, "log", event.stage, event.text)

    def _on_image(self, event: Preview) -> None:
        name = image_key(event.submap) if event.submap >= 0 else event.path
        known = self.images.pop(name, {})
        # If training resumed from a checkpoint, drop later images.
        self.images[name] = {step: one for step, one in known.items() if step < event.step} | {event.step: event}

    def _add_line(self, at: float, kind: str, stage: str, text: str) -> None:
        self.line_count += 1
        self.lines.append(LogLine(at, kind, f"{stage}: {text}" if stage else text))

    def _on_progress(self, at: float, event: Progress) -> None:
        former, self.progress = self.progress, event
        if former is None or (former.stage, former.total) != (event.stage, event.total) or event.done < former.done:
            self._marks.clear()
        self._marks.append((at, event.done))
        while len(self._marks) > 2 and at - self._marks[1][0] > WINDOW:
            self._marks.popleft()

    @property
    def share(self) -> float:
        """Progress of the current stage, 0 to 1."""
        p = self.progress
        return 0.0 if p is None or p.total <= 0 else min(max(p.done / p.total, 0.0), 1.0)

    @property
    def rate(self) -> float | None:
        """Units per second over the last half minute; None if not known yet."""
        if len(self._marks) < 2:
            return None
        (begin, first), (end, last) = self._marks[0], self._marks[-1]
        return (last - first) / (end - begin) if end - begin > 0.5 and last > first else None

    @property
    def seconds_left(self) -> float | None:
        """Remaining seconds of the current stage at the current rate; None if not known."""
        p, rate = self.progress, self.rate
        return None if p is None or rate is None else max(0.0, (p.total - p.done) / rate)


def folder_of(job: Job) -> Path | None:
    """The output folder of an export job of this user. None for other jobs, and if the folder does not exist yet."""
    if job.order.verb not in EXPORTS or not job.ours:
        return None
    words = list(job.order.arguments)
    named = value_of_flag(words, "--out", "")
    if not named and job.order.verb == "export features":
        named = os.path.join(value_of_flag(words, "--folder", ""), "features")
    folder = Path(named).absolute()
    return folder if named and "\0" not in named and is_folder(folder) else None
