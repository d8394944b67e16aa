"""How a job stands, as a value, and as the file that anyone may have written."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

from nvsim.files.nofollow import read_regular
from nvsim.project.orders import number_in

State = Literal["queued", "running", "paused", "done", "failed", "cancelled", "interrupted", "foreign"]
Wish = Literal["pause", "cancel"]
Ran = Literal["running", "done", "failed", "stopped", "interrupted"]
"""How a command stands that was run from a terminal, which nobody queues and which cannot be paused."""
RAN: tuple[Ran, ...] = get_args(Ran)
STATES: tuple[State, ...] = ("queued", "running", "paused", "done", "failed", "cancelled", "interrupted")
"""Those that are written down; a job is "foreign" for whoever did not order it."""
FULFILLED: dict[Wish, State] = {"pause": "paused", "cancel": "cancelled"}
STATUS, WISH = "standing.json", "wish"  # names of files, which older versions read as well
_MOST = 1 << 16  # bytes


@dataclass(frozen=True)
class JobStatus:
    """How a job stands. `pid` names the process while it runs, see `worker_lock`; seconds since the epoch; `worked`
    seconds of former runs; `code` the exit code once it ended; `message` one sentence about its end."""

    state: State = "queued"
    pid: int = 0
    started: float | None = None
    finished: float | None = None
    worked: float = 0.0
    code: int | None = None
    message: str = ""


def encode_status(status: JobStatus) -> str:
    return json.dumps(asdict(status))


def read_status(folder: Path) -> JobStatus:
    """The status of the job in `folder`: "queued" where none is written yet, "interrupted" where it is not readable."""
    try:
        data = json.loads(read_regular(folder / STATUS, _MOST))
        if not isinstance(data, dict) or data.get("state") not in STATES:
            raise ValueError("no state")
        code, pid, message = data.get("code"), data.get("pid", 0), data.get("message", "")
        if not isinstance(message, str) or type(pid) is not int or not (code is None or type(code) is int):
            raise ValueError("no status")
        started, finished = (None if data.get(n) is None else number_in(data[n]) for n in ("started", "finished"))
        return JobStatus(data["state"], pid, started, finished, number_in(data.get("worked", 0.0)), code, message)
    except FileNotFoundError:
        return JobStatus()
    except (OSError, ValueError, RecursionError, TypeError):
        return JobStatus("interrupted", message="The file that says how it stands is damaged.")


def wish_in(folder: Path) -> Wish | None:
    """What the job in `folder` was asked to do."""
    try:
        text = read_regular(folder / WISH, _MOST)
    except OSError:
        return None
    return "pause" if text == b"pause" else "cancel" if text == b"cancel" else None
