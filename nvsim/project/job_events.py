"""The events of a job as lines of a file: JSON with the time each was sent, `{"at": 1753.2, "event": "log", ...}`."""

from __future__ import annotations

import json
from pathlib import Path

from nvsim.events import Event, from_data, to_json


def event_line(event: Event, at: float) -> str:
    """The line, with its end; `at` in seconds since the epoch."""
    return f'{{"at": {at:.3f}, {to_json(event)[1:]}\n'


def event_of_line(line: str | bytes) -> tuple[float, Event]:
    """When it was sent, and the event. Raises ValueError when the line is none."""
    data = json.loads(line)
    if not isinstance(data, dict) or not isinstance(data.get("at"), int | float):
        raise ValueError(f"not an event of a job: {line[:80]!r}")
    return float(data.pop("at")), from_data(data)


class EventFile:
    """Reads the lines of a growing file, so many at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = 0
        self._rest = b""

    def read(self, most: int = 64 << 10) -> list[tuple[float, Event]]:
        """What was added, of `most` bytes at most. A line that is no event, as a kill may leave one, is left out."""
        try:
            with open(self._path, "rb") as file:
                file.seek(self._offset)
                data = file.read(most)
        except FileNotFoundError:
            return []
        self._offset += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = []
        for line in lines:
            try:
                found.append(event_of_line(line))
            except ValueError:
                continue
        return found

    @property
    def behind(self) -> bool:
        """Whether there is more to read."""
        try:
            return self._path.stat().st_size > self._offset
        except OSError:
            return False
