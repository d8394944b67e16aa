"""What of an export is finished, so that the same command goes on where one was cut off: a journal while it runs, and
the manifest, which is written last.

A part (the images of one viewpoint, the floor plans) is finished when its line stands in the journal, which is after
all its files are on disk. A line that was cut off is no line.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import own_file
from nvsim.files.regular import read_bytes, read_json, read_text
from nvsim.r2r.observations.places import ScanPlaces

_LARGEST = 1 << 30  # bytes of a journal
FORMAT = 1


@dataclass(frozen=True)
class Part:
    """key    of all that its files were made from
    files  path below the folder of the export -> bytes and SHA-256, in the order in which they were written
    """

    key: str
    files: Mapping[str, tuple[int, str]]

    def is_there(self, root: Path) -> bool:
        """Whether every file lies below `root` and has its size."""
        return all(_size(root / name) == size for name, (size, _) in self.files.items())

    def as_data(self) -> dict[str, Any]:
        """As `part_of` takes it."""
        files = {name: {"bytes": size, "sha256": digest} for name, (size, digest) in self.files.items()}
        return {"key": self.key, "files": files}


def part_of(data: Any) -> Part:
    """The part of a parsed line or manifest. Raises ValueError, KeyError or TypeError where it is none."""
    files = {}
    for name, file in data["files"].items():
        if not isinstance(file["bytes"], int) or not isinstance(file["sha256"], str):
            raise ValueError(name)
        files[str(name)] = file["bytes"], file["sha256"]
    if not isinstance(data["key"], str):
        raise ValueError("key")
    return Part(data["key"], files)


def key_of(*values: object) -> str:
    """A key of JSON-able values."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32]


def written(root: Path, files: Iterable[tuple[Path, bytes]], key: str) -> Part:
    """Writes files, each whole or not at all, and returns what they are. Raises InputError when the disk refuses."""
    found = {}
    for path, data in files:
        atomic.write_bytes(path, data)
        found[path.relative_to(root).as_posix()] = len(data), hashlib.sha256(data).hexdigest()
    return Part(key, found)


def part_on_disk(root: Path, files: Iterable[Path], key: str) -> Part:
    """The part of files that are written. Raises InputError when one cannot be read."""
    found = {}
    for path in files:
        data = read_bytes(path)
        found[path.relative_to(root).as_posix()] = len(data), hashlib.sha256(data).hexdigest()
    return Part(key, found)


class Record:
    """The finished parts of one scan, by name. Held by one process at a time, see `ScanPlaces.lock`."""

    def __init__(self, places: ScanPlaces, only_look: bool = False) -> None:
        """Reads the manifest and the journal that are there; begins a journal unless with `only_look`, which writes
        nothing. Raises InputError where the manifest is damaged."""
        self._places = places
        self.parts: dict[str, Part] = {}
        for name, data in read_manifest(places.manifest).get("parts", {}).items():
            self.parts[name] = _part(data, places.manifest)
        whole = self._take_over_journal()
        if not only_look:
            # A line that was cut off is left out, so that the next begins a line.
            atomic.write_text(places.journal, "".join(whole))
        self._before = {file for part in self.parts.values() for file in part.files}

    def finished(self, name: str, key: str) -> bool:
        """Whether the part is there, made from the same."""
        part = self.parts.get(name)
        return part is not None and part.key == key and part.is_there(self._places.root)

    def add(self, name: str, part: Part) -> None:
        """Raises InputError when the disk refuses."""
        self.parts[name] = part
        line = json.dumps({"part": name, **part.as_data()}, separators=(",", ":")) + "\n"
        try:
            file = own_file(self._places.journal, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            with os.fdopen(file, "ab") as journal:
                journal.write(line.encode())
                journal.flush()
                os.fsync(journal.fileno())
        except OSError as error:
            raise as_input_error(self._places.journal, error) from error

    def close(self, about: Mapping[str, Any], names: Iterable[str]) -> None:
        """Writes the manifest of the parts `names`, in this order, and ends the journal. Files that former exports of
        the scan wrote, and this one did not, are removed. Raises InputError when the disk refuses."""
        kept = {name: self.parts[name] for name in names}
        for file in self._before - {file for part in kept.values() for file in part.files}:
            if self._places.holds(file):
                (self._places.root / file).unlink(missing_ok=True)
        parts = {name: part.as_data() for name, part in kept.items()}
        text = json.dumps({"format": FORMAT, **about, "parts": parts}, indent=1)
        atomic.write_text(self._places.manifest, text + "\n")
        self._places.journal.unlink(missing_ok=True)

    def _take_over_journal(self) -> list[str]:
        """The whole lines of the journal, whose parts are known from now on."""
        path = self._places.journal
        if not os.path.lexists(path):
            return []
        whole = []
        for line in read_text(path, "a journal of an export", "remove it and export again", _LARGEST).splitlines():
            try:
                data = json.loads(line)
                self.parts[data["part"]] = part_of(data)
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
                continue
            whole.append(line + "\n")
        return whole


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest of a scan, {} where there is none. Raises InputError where it is damaged or newer."""
    if not os.path.lexists(path):
        return {}
    data = read_json(path, "the manifest of a scan", "remove it and export the scan again")
    if not isinstance(data, dict) or not isinstance(data.get("parts"), dict) or data.get("format") != FORMAT:
        raise InputError(f"{path} is no manifest that this NVSim can read; remove it and export the scan again.")
    return data


def _part(data: Any, path: Path) -> Part:
    try:
        return part_of(data)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is damaged; remove it and export the scan again.") from error


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except (OSError, ValueError):  # a name that no file can have
        return -1
