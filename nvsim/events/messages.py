"""Events as frozen dataclasses and their form as JSON lines: {"event": "progress", "stage": "train", ...}."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nvsim.errors import shown


@dataclass(frozen=True)
class Progress:
    """`done` of `total` units of `stage` (an identifier like "train"); `detail` names the part in hand."""

    stage: str
    done: int
    total: int
    detail: str = ""


@dataclass(frozen=True)
class Metric:
    """One measured number at a step: name like "psnr", value, the step it belongs to, the submap or -1."""

    stage: str
    name: str
    value: float
    step: int = 0
    submap: int = -1


@dataclass(frozen=True)
class Preview:
    """An image written to `path`, to be shown while the stage runs; of a training the step and the submap it shows, -1
    for none."""

    stage: str
    path: str
    caption: str = ""
    step: int = 0
    submap: int = -1


@dataclass(frozen=True)
class Log:
    """A sentence for the user who watches."""

    text: str
    stage: str = ""


@dataclass(frozen=True)
class Warning:
    """A sentence about what makes the result worse: what, where, what it causes."""

    text: str
    stage: str = ""


@dataclass(frozen=True)
class Worker:
    """A worker of a cluster, `name` as "HOST, process 12", and its piece of the stage: `part`, its number, and `words`
    for a user. `state`: it "works" on it, has "ended" it, or was "lost" with it."""

    stage: str
    name: str
    part: int
    words: str
    state: str


@dataclass(frozen=True)
class Done:
    """The stage ended well; `summary` is one sentence, `results` are JSON-able figures."""

    stage: str
    summary: str = ""
    results: dict[str, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class Failed:
    """The stage ended badly; `message` is one sentence, `code` the exit code (2 their mistake, 1 ours)."""

    stage: str
    message: str
    code: int = 1


Event = Progress | Metric | Preview | Log | Warning | Worker | Done | Failed
Listener = Callable[[Event], None]

_KINDS: dict[str, type] = {
    k.__name__.lower(): k for k in (Progress, Metric, Preview, Log, Warning, Worker, Done, Failed)
}


def silent(event: Event) -> None:
    """A listener that does nothing."""


def to_json(event: Event) -> str:
    """One line of JSON without a line end."""
    return json.dumps({"event": type(event).__name__.lower(), **dataclasses.asdict(event)})


def from_json(line: str) -> Event:
    """The event of one line. Raises ValueError when the line is not an event."""
    try:
        data = json.loads(line)
    except RecursionError as error:
        raise ValueError("not an event: it is nested too deeply") from error
    return from_data(data)


def from_data(data: Any) -> Event:
    """The event of a parsed line. Raises ValueError when it is none."""
    if not isinstance(data, dict) or not isinstance(data.get("event"), str) or data["event"] not in _KINDS:
        raise ValueError(f"not an event: {shown(data)}")
    kind = _KINDS[data["event"]]
    try:
        event: Event = kind(**{k: v for k, v in data.items() if k != "event"})
    except TypeError as error:
        raise ValueError(f"not an event: {shown(error)}") from error
    for field in dataclasses.fields(kind):
        if not _fits(getattr(event, field.name), field.type):
            raise ValueError(f"not an event: its {field.name} is not of the type {field.type}")
    return event


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value is of a field's type; a whole number counts as a float."""
    if kind in ("int", "float"):
        return (isinstance(value, int) and not isinstance(value, bool)) or (
            kind == "float" and isinstance(value, float)
        )
    return isinstance(value, str if kind == "str" else dict)
