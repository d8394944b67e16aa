"""The locations of files in an exported dataset. Independent of any network library."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.r2r.features.layouts import LAYOUTS


def scans_in(folder: Path) -> Path:
    """Returns the folder of an export's scans: the folder itself, or its folder `scans`."""
    inside = folder / "scans"
    return inside if (inside / "connectivity").is_dir() else folder


def features_in(folder: Path) -> Path:
    """Returns the only features file in an export. Raises InputError if there is none or more than one."""
    found = [path for layout in LAYOUTS.values() if (path := folder / "features" / layout.file).is_file()]
    if len(found) != 1:
        many = f"{len(found)} features files" if found else "no features file"
        then = "name one with --features" if found else f"write one with `nvsim export features {folder}`"
        raise InputError(f"{folder / 'features'} has {many}; {then}.")
    return found[0]
