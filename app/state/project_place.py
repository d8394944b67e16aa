"""Where a new project may lie. Knows no Qt."""

from __future__ import annotations

import os
from pathlib import Path

from nvsim.files.user_folders import home
from nvsim.footage.sources import VIDEO_SUFFIXES


def place_for(capture: Path) -> Path:
    """Beside the capture and named after its folder, or after its name if it is a video; in the user's own folder where
    nothing may be written there."""
    base = capture.parent if capture.is_file() else capture
    if capture.suffix.lower() in VIDEO_SUFFIXES:
        base = capture.with_suffix("")
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in base.name) or "building"
    place = base.parent if os.access(base.parent, os.W_OK) else home()
    return place / f"{name}.nvsim"


def problem_with(path: Path) -> str:
    """Why no project can be made there, in a sentence; "" when one can."""
    if (path / "project.db").is_file():
        return f"{path.name} is a project already; open it, or give the new one another name."
    above = next((p for p in path.parents if p.exists()), path)
    if not path.exists() and not os.access(above, os.W_OK):
        return f"{above} cannot be written; choose another place for the project."
    if path.is_file() or (path.is_dir() and any(path.iterdir())):
        return f"{path} holds other files; choose a new folder for the project."
    return ""
