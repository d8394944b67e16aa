"""The estimated size and time of an export of a scan or a dataset, from `nvsim export scan --dry-run` or `nvsim export
dataset --dry-run`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject

from app.jobs.question import Question

VERB, DATASET = "export scan", "export dataset"


@dataclass(frozen=True)
class Kind:
    """Files of one kind: description, number of files, total bytes."""

    what: str
    files: int
    bytes: int


@dataclass(frozen=True)
class ScanEstimate:
    """The estimate of an export.

    scans     ids of the scans to write
    kinds     the kinds of files
    files     total number of files
    bytes     total size of the files
    drawn     number of viewpoints with images
    todo      number of these viewpoints whose images are missing
    time      the expected duration as text
    free      free bytes on the target disk
    shortage  one sentence if the free space is too small, else ""
    """

    scans: tuple[str, ...]
    kinds: tuple[Kind, ...]
    files: int
    bytes: int
    drawn: int
    todo: int
    time: str
    free: int
    shortage: str


def estimate_of(text: str) -> ScanEstimate:
    """Parses the output of `--dry-run --json`. Raises ValueError if it is not an estimate."""
    try:
        data = json.loads(text)
        kinds = tuple(Kind(str(k["what"]), int(k["files"]), int(k["bytes"])) for k in data["kinds"])
        return ScanEstimate(
            tuple(str(scan) for scan in data["scans"]),
            kinds,
            int(data["files"]),
            int(data["bytes"]),
            int(data["drawn"]),
            int(data["todo"]),
            str(data["time"]),
            int(data["free"]),
            str(data["shortage"]),
        )
    except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f"not an estimate: {text[:80]!r}") from error


class ScanQuestion(Question):
    """Requests an estimate. Emits finished(ScanEstimate), or failed(str) with the reason why the export is impossible.
    Only the last `start` gets an answer."""

    def __init__(self, verb: str = VERB, parent: QObject | None = None) -> None:
        super().__init__(estimate_of, "The estimate", parent)
        self._verb = verb

    def start(self, project: Path, arguments: Sequence[str]) -> None:
        """Requests the estimate of the command with these arguments."""
        self.ask([*self._verb.split(), "--project", str(project), *arguments, "--dry-run", "--json"])
