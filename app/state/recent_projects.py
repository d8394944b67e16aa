"""The projects that were open lately, as the settings keep them, those that are gone too: a disk may come back."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QSettings

MOST = 10
_KEY = "recent"


class RecentProjects:
    """Newest first."""

    def __init__(self, settings: QSettings) -> None:
        self._settings = settings

    @property
    def paths(self) -> tuple[Path, ...]:
        """Whatever stands in the settings, as paths. None of them is looked at: a disk may not answer."""
        stored = self._settings.value(_KEY, [])
        names = [stored] if isinstance(stored, str) else stored if isinstance(stored, list) else []
        return tuple(dict.fromkeys(Path(str(name)) for name in names if name))[:MOST]

    def remember(self, project: Path) -> None:
        """It was opened just now."""
        path = project.absolute()
        self._keep([path, *(p for p in self.paths if p != path)])

    def forget(self, project: Path) -> None:
        """Takes it off the list; its files stay."""
        self._keep([p for p in self.paths if p != project])

    def _keep(self, paths: list[Path]) -> None:
        self._settings.setValue(_KEY, [str(path) for path in paths[:MOST]])
