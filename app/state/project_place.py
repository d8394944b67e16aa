"""The path of a new project. Does not use Qt."""

from __future__ import annotations

import os
from pathlib import Path

from nvsim.files.user_folders import home
from nvsim.footage.sources import VIDEO_SUFFIXES


def place_for(capture: Path) -> Path:
    """The default path of a new project: beside the capture, named after its folder, or after the file of a video. If
    that folder is not writable, in the user's home folder."""
    base = capture.parent if capture.is_file() else capture
    if capture.suffix.lower() in VIDEO_SUFFIXES:
        base = capture.with_suffix("")
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in base.name) or "building"
    place = base.parent if os.access(base.parent, os.W_OK) else home()
    return place / f"{name}.nvsim"


def problem_with(path: Path) -> str:
    """A sentence that says why a project cannot be created at `path`; "" if it can."""
    if (path / "project.db").is_file():
        return f"{path.name} is already a project; open it, or choose another name for the new project."
    above = next((p for p in path.parents if p.exists()), path)
    if not path.exists() and not os.access(above, os.W_OK):
        return f"{above} is not writable; choose another folder for the project."
    if path.is_file() or (path.is_dir() and any(path.iterdir())):
        return f"{path} contains other files; choose a new folder for the project."
    return ""
