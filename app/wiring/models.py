"""The window of the user's networks."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from app.actions import Action
from app.look.front import bring_up
from app.panels.models import ModelsWindow
from app.state.installed_models import InstalledModels
from app.wiring.part import Dock, Part


class ModelsPart(Part):
    """Opens the window of networks."""

    ACTIONS = (
        Action("models", "&Networks…",
               "Show the installed networks, their authors, and the networks that would improve results", "&Jobs", 4),
    )  # fmt: skip

    def docks(self) -> tuple[Dock, ...]:
        self.models = InstalledModels(self)
        self.page: ModelsWindow | None = None
        return ()

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"models": self.open_page}

    def store(self, settings: QSettings) -> None:
        self.models.stop()

    def open_page(self) -> ModelsWindow:
        """Shows the window. There is only one."""
        if self.page is None:
            self.page = ModelsWindow(self.models, self.context.window)
            self.page.destroyed.connect(self._forget)
        self.models.list()
        bring_up(self.page)
        return self.page

    def _forget(self) -> None:
        self.page = None
        self.models.stop()
