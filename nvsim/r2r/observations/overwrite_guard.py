"""Checks that an export never overwrites files that NVSim did not write."""

from __future__ import annotations

import os
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import PROJECT_DATABASE
from nvsim.r2r.observations.places import ScanPlaces


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
