"""Records the finished parts of an export, so that running the command again resumes an interrupted export.

There is a journal during the export, and a manifest, which is written last. A part (the images of one viewpoint, the
floor plans) is finished when its line is in the journal. The line is written after all files are on disk. An incomplete
line is ignored. An export never overwrites files that are in neither.
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
from nvsim.files.opening import PROJECT_DATABASE, open_own_file, read_bytes, read_json, read_text
from nvsim.r2r.observations.layout import ScanPlaces

_LARGEST = 1 << 30  # largest size of a journal in bytes
FORMAT = 1


@dataclass(frozen=True)
class FinishedPart:
    """One finished part.

    key    identifies everything from which its files were made
    files  path below the folder of the export -> bytes and SHA-256, in the order of writing
    """

    key: str
    files: Mapping[str, tuple[int, str]]

    def is_there(self, root: Path) -> bool:
        """Whether every file exists below `root` with the recorded size."""
        return all(_size(root / name) == size for name, (size, _) in self.files.items())

    def as_data(self) -> dict[str, Any]:
        """Returns the JSON data that `part_of` parses."""
        files = {name: {"bytes": size, "sha256": digest} for name, (size, digest) in self.files.items()}
        return {"key": self.key, "files": files}


def part_of(data: Any) -> FinishedPart:
    """Parses a part from JSON data. Raises ValueError, KeyError or TypeError if the data is invalid."""
    files = {}
    for name, file in data["files"].items():
        if not isinstance(file["bytes"], int) or not isinstance(file["sha256"], str):
            raise ValueError(name)
        files[str(name)] = file["bytes"], file["sha256"]
    if not isinstance(data["key"], str):
        raise ValueError("key")
    return FinishedPart(data["key"], files)


def key_of(*values: object) -> str:
    """Returns a key for JSON-compatible values."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32]


def write_part(root: Path, files: Iterable[tuple[Path, bytes]], key: str) -> FinishedPart:
    """Writes files atomically and returns them as a part. Raises InputError if writing fails."""
    found = {}
    for path, data in files:
        atomic.write_bytes(path, data)
        found[path.relative_to(root).as_posix()] = len(data), hashlib.sha256(data).hexdigest()
    return FinishedPart(key, found)


def part_on_disk(root: Path, files: Iterable[Path], key: str) -> FinishedPart:
    """Returns the part of files that already exist. Raises InputError if one is unreadable."""
    found = {}
    for path in files:
        data = read_bytes(path)
        found[path.relative_to(root).as_posix()] = len(data), hashlib.sha256(data).hexdigest()
    return FinishedPart(key, found)


class ScanRecord:
    """The finished parts of one scan, by name. Only one process may hold it at a time, see `ScanPlaces.lock`."""

    def __init__(self, places: ScanPlaces, only_look: bool = False) -> None:
        """Reads the manifest and the journal, and begins a new journal unless `only_look` is true.

        Raises InputError if the manifest is damaged.
        """
        self._places = places
        self.parts: dict[str, FinishedPart] = {}
        for name, data in read_manifest(places.manifest).get("parts", {}).items():
            self.parts[name] = _part(data, places.manifest)
        whole = self._take_over_journal()
        if not only_look:
            # Drops an incomplete last line, so that the next part begins on a new line.
            atomic.write_text(places.journal, "".join(whole))
        self._before = {file for part in self.parts.values() for file in part.files}

    def finished(self, name: str, key: str) -> bool:
        """Whether the part with this key is finished and its files exist."""
        part = self.parts.get(name)
        return part is not None and part.key == key and part.is_there(self._places.root)

    def add(self, name: str, part: FinishedPart) -> None:
        """Adds a finished part to the journal. Raises InputError if writing fails."""
        self.parts[name] = part
        line = json.dumps({"part": name, **part.as_data()}, separators=(",", ":")) + "\n"
        try:
            file = open_own_file(self._places.journal, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            with os.fdopen(file, "ab") as journal:
                journal.write(line.encode())
                journal.flush()
                os.fsync(journal.fileno())
        except OSError as error:
            raise as_input_error(self._places.journal, error) from error

    def close(self, about: Mapping[str, Any], names: Iterable[str]) -> None:
        """Writes the manifest of the parts `names`, in this order, and removes the journal.

        Files of earlier exports of the scan that are not in these parts are removed.

        Raises InputError if writing fails.
        """
        kept = {name: self.parts[name] for name in names}
        for file in self._before - {file for part in kept.values() for file in part.files}:
            if self._places.is_image_of_scan(file):
                (self._places.root / file).unlink(missing_ok=True)
        parts = {name: part.as_data() for name, part in kept.items()}
        text = json.dumps({"format": FORMAT, **about, "parts": parts}, indent=1)
        atomic.write_text(self._places.manifest, text + "\n")
        self._places.journal.unlink(missing_ok=True)

    def _take_over_journal(self) -> list[str]:
        """Returns the complete lines of the journal and adds their parts."""
        path = self._places.journal
        if not os.path.lexists(path):
            return []
        whole = []
        for line in read_text(path, "an export journal", "remove it and export again", _LARGEST).splitlines():
            try:
                data = json.loads(line)
                self.parts[data["part"]] = part_of(data)
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
                continue
            whole.append(line + "\n")
        return whole


def read_manifest(path: Path) -> dict[str, Any]:
    """Reads the manifest of a scan, {} if there is none. Raises InputError if it is damaged or of another format."""
    if not os.path.lexists(path):
        return {}
    data = read_json(path, "a scan manifest", "remove it and export the scan again")
    if not isinstance(data, dict) or not isinstance(data.get("parts"), dict) or data.get("format") != FORMAT:
        raise InputError(f"{path} is not a manifest of this NVSim version; remove it and export the scan again.")
    return data


def _part(data: Any, path: Path) -> FinishedPart:
    try:
        return part_of(data)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is damaged; remove it and export the scan again.") from error


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except (OSError, ValueError):  # ValueError: an invalid file name
        return -1


def refuse_foreign(places: ScanPlaces) -> None:
    """Raises InputError if the folder has other content than scans, or a scan of this name that NVSim did not write."""
    root = places.root
    if (root / PROJECT_DATABASE).exists():
        raise InputError(f"{root} is a project; choose another folder for the scan.")
    if not os.path.lexists(root):
        return
    if not root.is_dir():
        raise InputError(f"{root} is a file; choose a folder for the scan.")
    ours = places.manifest.exists() or places.journal.exists()
    if ours:
        return
    if os.path.lexists(places.folder) and _entries(places.folder) - {places.lock.name}:
        raise InputError(
            f"{places.folder} contains a scan that NVSim did not write; choose another --scan or another folder."
        )
    if places.connectivity.exists():
        raise InputError(
            f"{places.connectivity} belongs to a scan of this name that NVSim did not write; choose another --scan or "
            "another folder, or remove the file."
        )
    entries = _entries(root)
    if entries - {places.scan} and not places.scans.is_file() and not _has_ours(root):
        named = ", ".join(sorted(entries)[:3])
        raise InputError(
            f"{root} contains other files ({named}); choose a new folder, or one with connectivity/scans.txt."
        )


def _has_ours(root: Path) -> bool:
    """Whether the folder contains a finished or interrupted export of another scan or part."""
    return any(root.glob("*/manifest.json")) or any(root.glob("*/.unfinished.jsonl"))


def remove_leftovers(places: ScanPlaces) -> None:
    """Removes the temporary files of an interrupted export."""
    folders = [places.folder, places.images, places.views, places.plans]
    if places.views.is_dir():
        folders += [p for p in places.views.iterdir() if p.is_dir() and not p.is_symlink()]
    for folder in folders:
        for name in _entries(folder) if folder.is_dir() else ():
            if name.startswith(".") and name not in (places.lock.name, places.journal.name):
                atomic.remove(folder / name)
    for path in places.graphs.glob(f".{places.connectivity.stem[:40]}-*") if places.graphs.is_dir() else ():
        atomic.remove(path)


def _entries(folder: Path) -> set[str]:
    try:
        return set(os.listdir(folder))
    except OSError as error:
        raise InputError(f"Cannot read {folder}: {error.strerror}; choose another folder.") from error
