"""The files of a job: its order, its status, and its events. Each is a value here, and untrusted on disk.

A project from another person may contain any jobs and settings. A proof is a keyed hash, with a secret stored outside
the project. Data without a valid proof for this project was not ordered here. The proof includes the path of the
project, so a copy of the project has no valid proofs.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import hmac
import json
import os
import secrets
import stat
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.errors import InputError
from nvsim.events import Done, Event, Failed, Log, from_data, to_json
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import open_own_file, open_regular, read_regular
from nvsim.files.records import record_of
from nvsim.files.user_folders import xdg_folder

_SIZE = 32  # bytes of the secret


def secret_path() -> Path:
    """The path of this user's secret, in the state folder of the XDG specification."""
    return xdg_folder("XDG_STATE_HOME", ".local/state") / "nvsim" / "orders.key"


def order_proof(root: Path, what: str, said: Any) -> str:
    """The proof that `said` (JSON values) was ordered here for the project at `root`. `what` is its kind, such as
    "order". The first proof creates the secret. Raises InputError if the secret cannot be read or written."""
    text = json.dumps([what, os.path.realpath(root), said], sort_keys=True, separators=(",", ":"))
    return hmac.new(_secret(make=True), text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()


def is_order_proven(root: Path, what: str, said: Any, proof: object) -> bool:
    """Whether `proof` is the result of `order_proof` for these arguments. Also False if there is no secret yet."""
    if not isinstance(proof, str) or not proof.isascii():
        return False
    text = json.dumps([what, os.path.realpath(root), said], sort_keys=True, separators=(",", ":"))
    try:
        secret = _secret(make=False)
    except InputError:
        return False
    return hmac.compare_digest(
        hmac.new(secret, text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest(), proof
    )


def _secret(make: bool) -> bytes:
    path = secret_path()
    try:
        try:
            return _read(path)
        except FileNotFoundError:
            if not make:
                raise
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        return _create_secret(path)
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ELOOP, errno.EINVAL):
            raise InputError(
                f"{path} is not a secret that only you can read; remove it, and order your jobs again."
            ) from error
        raise as_input_error(path, error) from error


def _read(path: Path) -> bytes:
    descriptor = open_regular(path, os.O_RDONLY)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        data = file.read(_SIZE + 1)
    others = stat.S_IRWXG | stat.S_IRWXO
    if found.st_uid != os.geteuid() or found.st_mode & others or len(data) != _SIZE:
        raise OSError(errno.EINVAL, "other users can read it, or it is incomplete", str(path))
    return data


def _create_secret(path: Path) -> bytes:
    """A new secret, written atomically. If two processes create one, both use the first."""
    temporary = path.with_name(f".{path.name}-{os.getpid()}-{secrets.token_hex(4)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        with open(descriptor, "wb") as file:
            file.write(secrets.token_bytes(_SIZE))
            file.flush()
            os.fsync(descriptor)
        with contextlib.suppress(FileExistsError):
            os.link(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return _read(path)


State = Literal["queued", "running", "paused", "done", "failed", "cancelled", "interrupted", "foreign"]
Wish = Literal["pause", "cancel"]
STATES: tuple[State, ...] = ("queued", "running", "paused", "done", "failed", "cancelled", "interrupted")
"""The states in files; "foreign" is not stored, because it depends on the user."""
STATE_AFTER_REQUEST: dict[Wish, State] = {"pause": "paused", "cancel": "cancelled"}
STATUS, WISH = "standing.json", "wish"  # file names that older versions read too
_MOST_STATUS = 1 << 16  # bytes
_ORDER = "order.json"
_MOST_ORDER = 1 << 20  # bytes of the file
_WHAT = "order"
MOST_BYTES = 64 << 20  # of a file of events that are read
MOST_LINE = 1 << 20  # bytes of a line


# Order --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JobCommand:
    """The command of a job: `nvsim VERB ARGUMENTS`.

    title    name of the job for the user
    heavy    wait until no other heavy job runs on the project
    ordered  seconds since the epoch
    folder   the current folder of a command in a terminal, to which its paths are relative; "" for orders of the window
    """

    verb: str
    arguments: tuple[str, ...]
    title: str
    heavy: bool = True
    ordered: float = 0.0
    folder: str = ""


def encode_order(root: Path, number: int, order: JobCommand) -> str:
    """The text of the order file, with the proof that this user ordered it on the project at `root`. Raises InputError
    if the secret for the proof cannot be read or created."""
    return json.dumps({**asdict(order), "proof": order_proof(root, _WHAT, [number, asdict(order)])})


def read_order(root: Path, number: int, folder: Path) -> tuple[JobCommand, bool]:
    """The order of the job in `folder`, and whether this user ordered exactly this job on this project. Raises OSError
    or ValueError if the order is missing or damaged."""
    try:
        data = json.loads(read_regular(folder / _ORDER, _MOST_ORDER))
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    order, said = _order(data), {name: value for name, value in data.items() if name != "proof"}
    return order, is_order_proven(root, _WHAT, [number, said], data.get("proof"))


def order_path(folder: Path) -> Path:
    return folder / _ORDER


def _order(data: Any) -> JobCommand:
    fields = {"verb", "arguments", "title", "heavy", "ordered"}
    if not isinstance(data, Mapping) or set(data) - {"proof", "folder"} != fields:
        raise ValueError("it does not have the fields of an order")
    return record_of(JobCommand, data)


# Status -------------------------------------------------------------------------------------------------------------


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
        data = json.loads(read_regular(folder / STATUS, _MOST_STATUS))
        if not isinstance(data, dict) or data.get("state") not in STATES:
            raise ValueError("no state")
        return record_of(JobStatus, data)
    except FileNotFoundError:
        return JobStatus()
    except (OSError, ValueError, RecursionError, TypeError):
        return JobStatus("interrupted", message="The file with its status is damaged.")


def requested_state(folder: Path) -> Wish | None:
    """The user's request to the job in `folder`, None if there is none."""
    try:
        text = read_regular(folder / WISH, _MOST_STATUS)
    except OSError:
        return None
    return "pause" if text == b"pause" else "cancel" if text == b"cancel" else None


# Events -------------------------------------------------------------------------------------------------------------


def event_line(event: Event, at: float) -> str:
    """One line for `event`, including the line end; `at` is in seconds since the epoch."""
    return f'{{"at": {at:.3f}, {to_json(event)[1:]}\n'


def event_of_line(line: str | bytes) -> tuple[float, Event]:
    """Time of sending (seconds since the epoch) and event. Raises ValueError if the line is not an event of a job."""
    data = json.loads(line)
    if not isinstance(data, dict) or not isinstance(data.get("at"), int | float) or not abs(data["at"]) < 1e15:
        raise ValueError(f"not an event of a job: {line[:80]!r}")
    if any(isinstance(value, int) and abs(value) >= 1 << 63 for value in data.values()):
        raise ValueError("a number that is too large for a job")
    return float(data.pop("at")), from_data(data)


class EventWriter:
    """A listener that appends events to the file at `path`. message: the last sentence about the work. Raises OSError
    if the file cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.message = ""
        self._file = os.fdopen(open_own_file(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab", buffering=0)

    def __call__(self, event: Event) -> None:
        if isinstance(event, Failed):
            self.message = event.message
        elif isinstance(event, Done) or (isinstance(event, Log) and event.stage):
            self.message = event.summary if isinstance(event, Done) else event.text
        with contextlib.suppress(OSError):  # if the disk is full, the command itself reports it
            self._file.write(event_line(event, time.time()).encode())

    def close(self) -> None:
        self._file.close()


class EventFile:
    """Reads the lines of a growing file in portions. Only the last 64 MB of a file are read, and lines over 1 MB are
    skipped."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset: int | None = None  # None: nothing is read yet
        self._rest = b""
        self._passing = False  # the rest of the current line is skipped

    def read(self, most: int = 64 << 10) -> list[tuple[float, Event]]:
        """The events in the next `most` bytes at most. Skips lines that are not events, such as a truncated one."""
        try:
            with open(open_regular(self._path), "rb") as file:
                if self._offset is None:
                    self._offset = max(0, os.fstat(file.fileno()).st_size - MOST_BYTES)
                    self._passing = self._offset > 0
                file.seek(self._offset)
                data = file.read(most)
        except OSError:
            return []
        self._offset += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = []
        for line in lines:
            passing, self._passing = self._passing, False
            if passing or len(line) > MOST_LINE:
                continue
            try:
                found.append(event_of_line(line))
            except (ValueError, RecursionError):
                continue
        if len(self._rest) > MOST_LINE:
            self._rest, self._passing = b"", True
        return found

    @property
    def has_unread_events(self) -> bool:
        """Whether the file has more data to read."""
        try:
            found = os.lstat(self._path)
        except (OSError, ValueError):
            return False
        return stat.S_ISREG(found.st_mode) and found.st_size > (self._offset or 0)
