"""The recently opened projects, stored in the settings, and the path of a new project. Missing projects stay in the
list, because a disk may be connected again."""

from __future__ import annotations

import os
from pathlib import Path

from PySide6.QtCore import QSettings

from nvsim.files.user_folders import home_folder
from nvsim.footage.sources import VIDEO_SUFFIXES

MOST = 10
_KEY = "recent"


class RecentProjects:
    """The list of recent projects, the newest first."""

    def __init__(self, settings: QSettings) -> None:
        self._settings = settings

    @property
    def paths(self) -> tuple[Path, ...]:
        """The stored paths. They are not accessed, because a disk may not respond."""
        stored = self._settings.value(_KEY, [])
        names = [stored] if isinstance(stored, str) else stored if isinstance(stored, list) else []
        return tuple(dict.fromkeys(Path(str(name)) for name in names if name))[:MOST]

    def remember(self, project: Path) -> None:
        """Moves a project that was just opened to the top of the list."""
        path = project.absolute()
        self._keep([path, *(p for p in self.paths if p != path)])

    def remove(self, project: Path) -> None:
        """Removes a project from the list. Its files are not changed."""
        self._keep([p for p in self.paths if p != project])

    def _keep(self, paths: list[Path]) -> None:
        self._settings.setValue(_KEY, [str(path) for path in paths[:MOST]])


def place_for(capture: Path) -> Path:
    """The default path of a new project: beside the capture, named after its folder, or after the file of a video. If
    that folder is not writable, in the user's home folder."""
    base = capture.parent if capture.is_file() else capture
    if capture.suffix.lower() in VIDEO_SUFFIXES:
        base = capture.with_suffix("")
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in base.name) or "building"
    place = base.parent if os.access(base.parent, os.W_OK) else home_folder()
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
