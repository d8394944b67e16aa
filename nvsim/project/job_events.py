"""The events of a job as lines of a file: JSON with the time each was sent, `{"at": 1753.2, "event": "log", ...}`."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

from nvsim.events import Event, from_data, to_json
from nvsim.files.nofollow import open_regular

MOST_BYTES = 64 << 20  # of a file
MOST_LINE = 1 << 20  # bytes of a line


def event_line(event: Event, at: float) -> str:
    """The line, with its end; `at` in seconds since the epoch."""
    return f'{{"at": {at:.3f}, {to_json(event)[1:]}\n'


def event_of_line(line: str | bytes) -> tuple[float, Event]:
    """When it was sent, and the event. Raises ValueError when the line is none."""
    data = json.loads(line)
    if not isinstance(data, dict) or not isinstance(data.get("at"), int | float) or not abs(data["at"]) < 1e15:
        raise ValueError(f"not an event of a job: {line[:80]!r}")
    if any(isinstance(value, int) and abs(value) >= 1 << 63 for value in data.values()):
        raise ValueError("a number that no job counts to")
    return float(data.pop("at")), from_data(data)


class EventFile:
    """Reads the lines of a growing file, so many at a time. Of a file that is longer than any job writes the end is
    read; a line that is longer than any event is passed over."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset: int | None = None  # None: not begun
        self._rest = b""
        self._passing = False  # over the rest of a line

    def read(self, most: int = 64 << 10) -> list[tuple[float, Event]]:
        """What was added, of `most` bytes at most. A line that is no event, as a kill may leave one, is left out."""
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
        """Whether there is more to read."""
        try:
            found = os.lstat(self._path)
        except (OSError, ValueError):
            return False
        return stat.S_ISREG(found.st_mode) and found.st_size > (self._offset or 0)
