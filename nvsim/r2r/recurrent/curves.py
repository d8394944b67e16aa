"""The training curves: events as JSON lines, as `--json` prints them, in `curves.jsonl` of the agent's folder."""

from __future__ import annotations

import os
from pathlib import Path

from nvsim.events import Listener, Metric
from nvsim.events.messages import from_json, to_json
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import plain_file
from nvsim.files.regular import read_text

FILE = "curves.jsonl"
STAGE = "r2r train"
_LARGEST = 1 << 28


class Curves:
    """Appends every metric to the file and sends it to the listener. Metrics after `step`, from an interrupted run, are
    dropped first. Raises InputError if writing fails.
    """

    def __init__(self, folder: Path, step: int, listen: Listener) -> None:
        self._path, self._listen = folder / FILE, listen
        kept = [metric for metric in read_curves(folder) if metric.step <= step] if step else []
        atomic.write_text(self._path, "".join(to_json(metric) + "\n" for metric in kept))

    def add(self, name: str, value: float, step: int) -> None:
        metric = Metric(STAGE, name, value, step)
        try:
            with open(plain_file(self._path, os.O_WRONLY | os.O_APPEND), "a", encoding="utf-8") as file:
                file.write(to_json(metric) + "\n")
        except OSError as error:
            raise as_input_error(self._path, error) from error
        self._listen(metric)


def read_curves(folder: Path) -> list[Metric]:
    """Reads the metrics of a training and ignores incomplete lines. Raises InputError if the file is unreadable."""
    path = folder / FILE
    if not path.is_file():
        return []
    found = []
    for line in read_text(path, "a file of training curves", "remove it", _LARGEST).splitlines():
        try:
            event = from_json(line)
        except ValueError:
            continue
        if isinstance(event, Metric):
            found.append(event)
    return found
