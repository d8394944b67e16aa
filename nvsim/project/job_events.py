"""The events of a job as lines of JSON with the time of sending: `{"at": 1753.2, "event": "log", ...}`."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

from nvsim.events import Event, from_data, to_json
from nvsim.files.opening import open_regular

MOST_BYTES = 64 << 20  # of a file that are read
MOST_LINE = 1 << 20  # bytes of a line


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
    def behind(self) -> bool:
        """Whether the file has more data to read."""
        try:
            found = os.lstat(self._path)
        except (OSError, ValueError):
            return False
        return stat.S_ISREG(found.st_mode) and found.st_size > (self._offset or 0)
