"""The status of a job, as a value and as an untrusted file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

from nvsim.files.opening import read_regular
from nvsim.project.orders import number_in

State = Literal["queued", "running", "paused", "done", "failed", "cancelled", "interrupted", "foreign"]
Wish = Literal["pause", "cancel"]
Ran = Literal["running", "done", "failed", "stopped", "interrupted"]
"""State of a command that was run in a terminal, which has no queue and cannot be paused."""
RAN: tuple[Ran, ...] = get_args(Ran)
STATES: tuple[State, ...] = ("queued", "running", "paused", "done", "failed", "cancelled", "interrupted")
"""The states in files; "foreign" is not stored, because it depends on the user."""
STATE_AFTER_REQUEST: dict[Wish, State] = {"pause": "paused", "cancel": "cancelled"}
STATUS, WISH = "standing.json", "wish"  # file names that older versions read too
_MOST = 1 << 16  # bytes


@dataclass(frozen=True)
class JobStatus:
    """The status of a job.

    pid                process id while the job runs, see `worker_lock`
    started, finished  seconds since the epoch
    worked             seconds of previous runs
    code               exit code of a finished job
    message            one sentence about its end
    """

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
    """The status of the job in `folder`: "queued" if none is stored yet, "interrupted" if the file is damaged."""
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
        return JobStatus("interrupted", message="The file with its status is damaged.")


def requested_state(folder: Path) -> Wish | None:
    """The user's request to the job in `folder`, None if there is none."""
    try:
        text = read_regular(folder / WISH, _MOST)
    except OSError:
        return None
    return "pause" if text == b"pause" else "cancel" if text == b"cancel" else None
