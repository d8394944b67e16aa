"""The typed messages that a long computation sends: progress, metric, preview, log, warning, worker, done, failed.

A computation takes a `Listener` and calls it with each event. The command line draws the events, `--json` prints one
line per event ({"event": "progress", "stage": "train", ...}), and the window reads those lines. This module does not
depend on any listener.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nvsim.errors import value_text


@dataclass(frozen=True)
class Progress:
    """`done` of `total` units of `stage` (an identifier like "train"); `detail` names the current part."""

    stage: str
    done: int
    total: int
    detail: str = ""


@dataclass(frozen=True)
class Metric:
    """One measured value.

    name    for example "psnr"
    step    the training step of the measurement
    submap  number of the submap, -1 for none
    """

    stage: str
    name: str
    value: float
    step: int = 0
    submap: int = -1


@dataclass(frozen=True)
class Preview:
    """An image file that users see while the stage runs.

    step    the training step that the image shows
    submap  number of the submap that the image shows, -1 for none
    """

    stage: str
    path: str
    caption: str = ""
    step: int = 0
    submap: int = -1


@dataclass(frozen=True)
class Log:
    """A sentence for the user."""

    text: str
    stage: str = ""


@dataclass(frozen=True)
class Warning:
    """A sentence about a problem that degrades the result: the problem, its place, and its effect."""

    text: str
    stage: str = ""


@dataclass(frozen=True)
class Worker:
    """The state of a worker process of a cluster.

    name   for example "HOST, process 12"
    part   number of the worker's piece of the stage
    words  the piece as users read it
    state  "works": the piece has started; "ended": it is finished; "lost": the worker failed
    """

    stage: str
    name: str
    part: int
    words: str
    state: str


@dataclass(frozen=True)
class Done:
    """The stage succeeded; `summary` is one sentence, `results` are figures that JSON can store."""

    stage: str
    summary: str = ""
    results: dict[str, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class Failed:
    """The stage failed; `message` is one sentence, `code` the exit code (2 for a user error, 1 for a bug)."""

    stage: str
    message: str
    code: int = 1


Event = Progress | Metric | Preview | Log | Warning | Worker | Done | Failed
Listener = Callable[[Event], None]

_KINDS: dict[str, type] = {
    k.__name__.lower(): k for k in (Progress, Metric, Preview, Log, Warning, Worker, Done, Failed)
}


def ignore_event(event: Event) -> None:
    """A listener that does nothing."""


def to_json(event: Event) -> str:
    """The event as one line of JSON, without a line end."""
    return json.dumps({"event": type(event).__name__.lower(), **dataclasses.asdict(event)})


def from_json(line: str) -> Event:
    """Parses one line. Raises ValueError if the line is not an event."""
    try:
        data = json.loads(line)
    except RecursionError as error:
        raise ValueError("not an event: it is nested too deeply") from error
    return from_data(data)


def from_data(data: Any) -> Event:
    """The event in parsed JSON. Raises ValueError if `data` is not an event."""
    if not isinstance(data, dict) or not isinstance(data.get("event"), str) or data["event"] not in _KINDS:
        raise ValueError(f"not an event: {value_text(data)}")
    kind = _KINDS[data["event"]]
    try:
        event: Event = kind(**{k: v for k, v in data.items() if k != "event"})
    except TypeError as error:
        raise ValueError(f"not an event: {value_text(error)}") from error
    for field in dataclasses.fields(kind):
        if not _has_type(getattr(event, field.name), field.type):
            raise ValueError(f"not an event: its {field.name} is not of the type {field.type}")
    return event


def _has_type(value: Any, kind: Any) -> bool:
    """Whether a value has the type of a field; an integer is also valid as a float."""
    if kind in ("int", "float"):
        return (isinstance(value, int) and not isinstance(value, bool)) or (
            kind == "float" and isinstance(value, float)
        )
    return isinstance(value, str if kind == "str" else dict)
