"""Tests with a file of random content whether another machine can read the files of this one."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from pathlib import Path

from nvsim.files import atomic
from nvsim.files.opening import read_regular

_PREFIX = ".storage-"


@dataclass(frozen=True)
class StorageProbe:
    """A test file that other machines look for.

    path     path of the file
    word     its random content
    beside   files of other folders that must exist too, with their sizes in bytes
    """

    path: Path
    word: str
    beside: tuple[tuple[Path, int], ...] = ()

    @staticmethod
    def create_in(folder: Path, *beside: Path) -> StorageProbe:
        """Writes a test file. Raises InputError if the disk reports an error."""
        word = secrets.token_hex(16)
        path = atomic.make_folder(folder) / f"{_PREFIX}{word[:8]}"
        atomic.write_text(path, word)
        return StorageProbe(path, word, tuple((p, p.stat().st_size) for p in beside))

    def missing(self) -> str:
        """The path that this machine cannot read, "" if it can read all files."""
        try:
            if read_regular(self.path, 64).decode() != self.word:
                return str(self.path.parent)
        except (OSError, ValueError):
            return str(self.path.parent)
        for path, size in self.beside:
            try:
                if path.stat().st_size != size:
                    return str(path)
            except OSError:
                return str(path)
        return ""

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)
