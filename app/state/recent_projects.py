"""The recently opened projects, stored in the settings. Missing projects stay in the list, because a disk may be
connected again."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QSettings

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

    def forget(self, project: Path) -> None:
        """Removes a project from the list. Its files are not changed."""
        self._keep([p for p in self.paths if p != project])

    def _keep(self, paths: list[Path]) -> None:
        self._settings.setValue(_KEY, [str(path) for path in paths[:MOST]])
