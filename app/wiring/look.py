"""The appearance of the window (theme, full screen), and the help pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from app.actions import Action
from app.look import theme
from app.look.front import bring_up
from app.panels.about import AboutWindow
from app.panels.help import open_help
from app.wiring.part import Part


class LookPart(Part):
    """Commands for the theme, full screen, and help."""

    ACTIONS = (
        Action("dark", "Dar&k theme", "Switch between dark and light", "&Window", shortcut="Ctrl+T", icon="theme",
               check="on"),
        Action("fullscreen", "F&ull screen", "Use the whole screen", "&Window", shortcut="F11", icon="fullscreen",
               check="off"),
        Action("help", "&Help pages", "Read or search the help", "&Help", 1, "F1", "help"),
        Action("help_keys", "&Keys and mouse", "Read how to move around and what the keys do", "&Help", 1, "Shift+F1"),
        Action("about", "&About NVSim", "Show the version and a system report to copy", "&Help", 2),
    )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        window = self.context.window
        return {
            "dark": self._set_dark,
            "fullscreen": lambda on: window.showFullScreen() if on else window.showNormal(),
            "help": lambda: open_help("start", window),
            "help_keys": lambda: open_help("keys", window),
            "about": self._show_about,
        }

    def restore(self, settings: QSettings) -> None:
        self.context.preferences.changed.connect(self._on_preference)
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._on_desktop)
        self._show_switch()

    def _show_switch(self) -> None:
        dark = self.context.window.actions_table["dark"]
        dark.blockSignals(True)
        dark.setChecked(theme.is_dark(QApplication.palette()))
        dark.blockSignals(False)

    def _show_about(self) -> None:
        bring_up(AboutWindow(self.context.document.path, self.context.window))

    def _set_dark(self, dark: bool) -> None:
        name = "dark" if dark else "light"
        if self.context.preferences["theme"] == name:  # the window was started with another theme
            self._dress()
        self.context.preferences.set("theme", name)

    def _on_preference(self, key: str) -> None:
        if key == "theme":
            self._dress()

    def _on_desktop(self) -> None:
        """Follows a change of the desktop's theme."""
        if self.context.preferences["theme"] == theme.SYSTEM:
            self._dress()

    def _dress(self) -> None:
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        theme.apply(app, str(self.context.preferences["theme"]))
        self._show_switch()
