"""The command palette (Ctrl+P, also Ctrl+Shift+P)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from PySide6.QtCore import QSettings
from PySide6.QtGui import QKeySequence, QShortcut

from app.actions import Action
from app.palette.entries import Entry, commands, fitting, places
from app.palette.popup import PaletteView
from app.wiring.part import Part, WindowContext

_REMEMBERED = 12


class PalettePart(Part):
    """Opens the command palette and stores the recent commands."""

    ACTIONS = (
        Action("palette", "&Command palette…", "Find any command, viewpoint, or frame by a few letters", "&Help", 0,
               "Ctrl+P", "palette"),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._recent: list[str] = []
        self.view = PaletteView(self._offer, context.window)
        self.view.ran.connect(self._on_ran)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"palette": self.view.open}

    def restore(self, settings: QSettings) -> None:
        QShortcut(QKeySequence("Ctrl+Shift+P"), self.context.window, self.view.open)
        stored = settings.value("palette/recent", [])
        self._recent = [str(title) for title in stored] if isinstance(stored, list) else []

    def store(self, settings: QSettings) -> None:
        settings.setValue("palette/recent", self._recent)

    def _offer(self, typed: str) -> list[Entry]:
        document = self.context.document
        own = [e for e in commands(self.context.window.actions_table, document) if e.title != "Command palette"]
        return [
            *fitting([*own, *self._panels(), *self._layers()], typed, self._recent),
            *places(document, typed, self._go_to_viewpoint, self._go_to_frame),
        ]

    def _panels(self) -> list[Entry]:
        """An entry for each panel, which shows it."""
        window = self.context.window
        return [
            Entry(f"Show panel {title}", "Window", "", "", partial(window.show_dock, name))
            for name, title in window.dock_titles.items()
        ]

    def _layers(self) -> list[Entry]:
        """An entry for each layer of the 3D view, which shows or hides it."""
        overlays = self.context.scene.overlays
        return [
            Entry(
                f"Layer {layer.title}{' (on)' if layer.shown else ' (off)'}", "View", "", "",
                partial(overlays.set_shown, layer.name, not layer.shown),
            )
            for layer in reversed(overlays.layers)
        ]  # fmt: skip

    def _go_to_viewpoint(self, id: str) -> None:
        arrays = self.context.document.graph_arrays
        self.context.document.select(viewpoint=id)
        self.context.scene.go_to_position(arrays.positions[arrays.index[id]])

    def _go_to_frame(self, frame: int) -> None:
        self.context.document.select(frame=frame)
        self.context.scene.snap_to_frame(frame)

    def _on_ran(self, entry: Entry) -> None:
        title = entry.title.removesuffix(" (on)").removesuffix(" (off)")
        if entry.place.startswith("Go to"):
            return
        self._recent = [title, *(t for t in self._recent if t != title)][:_REMEMBERED]
