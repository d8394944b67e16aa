"""What lies where in an exported dataset. Knows no network."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.r2r.features.layouts import LAYOUTS


def scans_in(folder: Path) -> Path:
    """Where the scans of an export lie: in the folder itself, or in its `scans`."""
    inside = folder / "scans"
    return inside if (inside / "connectivity").is_dir() else folder


def features_in(folder: Path) -> Path:
    """The only file of features in an export. Raises InputError where there is none, or more than one."""
    found = [path for layout in LAYOUTS.values() if (path := folder / "features" / layout.file).is_file()]
    if len(found) != 1:
        many = f"{len(found)} files" if found else "no file"
        then = "name one with --features" if found else f"write one with `nvsim export features {folder}`"
        raise InputError(f"{folder / 'features'} holds {many} of features; {then}.")
    return found[0]
