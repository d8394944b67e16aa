"""Failed floor masks and the reasons, in a file beside the masks."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

from nvsim.errors import InputError
from nvsim.files.atomic import write_text
from nvsim.files.opening import read_json
from nvsim.perception.roles import Failure

NAME = "failures.json"


class Failures:
    """The reasons for the failed masks of a folder. Safe to use from several threads."""

    def __init__(self, folder: Path) -> None:
        self._path, self._lock = folder / NAME, threading.Lock()
        self.of_frames = read_failures(folder)

    def add(self, index: int, failure: Failure) -> None:
        """Records the failure of frame `index`. Raises InputError if the file cannot be written."""
        with self._lock:
            self.of_frames[index] = failure
            self._write()

    def remove_frames(self, frames: Iterable[int]) -> None:
        """Removes the reasons for frames whose masks are computed again."""
        gone = set(frames) & self.of_frames.keys()
        if gone:
            for index in gone:
                del self.of_frames[index]
            self._write()

    def _write(self) -> None:
        write_text(self._path, json.dumps({str(index): self.of_frames[index] for index in sorted(self.of_frames)}))


def read_failures(folder: Path) -> dict[int, Failure]:
    """Frame index -> reason. Empty if the file is missing or unreadable; entries that are not valid are skipped."""
    if not (folder / NAME).is_file():
        return {}
    try:
        found = read_json(folder / NAME, "why masks failed", "find the floor again")
    except InputError:
        return {}
    rows = found.items() if isinstance(found, dict) else ()
    words: tuple[Failure, ...] = get_args(Failure)
    known = {word: word for word in words if word}
    return {int(key): known[word] for key, word in rows if key.isdecimal() and isinstance(word, str) and word in known}
