"""What an export of a scan or a dataset comes to, as `nvsim export scan --dry-run` and its like say it: they read the
project, split large graphs and sample paths."""

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
    """Files of one kind: what they are, how many, bytes of all."""

    what: str
    files: int
    bytes: int


@dataclass(frozen=True)
class ScanEstimate:
    """scans     ids of what will be written
    kinds     of files
    files     how many there are
    bytes     of all of them
    drawn, todo  viewpoints with images, and those of them that are not there yet
    time      how long it takes, in words
    free      bytes, where it is written
    shortage  one sentence where that is too little, else ""
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
    """What `--dry-run --json` of the command printed. Raises ValueError when it is something else."""
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
    """finished(ScanEstimate), or failed(str) with the sentence that speaks against the export; of the last `start`."""

    def __init__(self, verb: str = VERB, parent: QObject | None = None) -> None:
        super().__init__(estimate_of, "The estimate", parent)
        self._verb = verb

    def start(self, project: Path, arguments: Sequence[str]) -> None:
        """Asks what the command with these arguments comes to."""
        self.ask([*self._verb.split(), "--project", str(project), *arguments, "--dry-run", "--json"])
