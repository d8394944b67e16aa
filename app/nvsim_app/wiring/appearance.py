"""Commands of the whole window: theme, full screen, help pages, keyboard focus, command palette, and preferences."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from PySide6.QtCore import QRect, QSettings, QSignalBlocker, Qt
from PySide6.QtGui import QGuiApplication, QKeySequence, QShortcut
from PySide6.QtWidgets import QApplication, QWidget
from shiboken6 import isValid

from nvsim_app.actions import Action
from nvsim_app.look import lengths, theme
from nvsim_app.look.widgets import FocusRing, show_and_focus
from nvsim_app.palette.entries import PaletteEntry, commands, matching_entries, places
from nvsim_app.palette.popup import PaletteView
from nvsim_app.panels.about import AboutWindow
from nvsim_app.panels.help import open_help
from nvsim_app.panels.preference_dialog import PreferenceDialog
from nvsim_app.panels.preferences import KeyBindings
from nvsim_app.views.navigation import ControlSettings
from nvsim_app.wiring.part import Part, WindowContext


class LookPart(Part):
    """Commands for the theme, full screen, and help."""

    def restore(self, settings: QSettings) -> None:
        self.context.preferences.changed.connect(self._on_preference)
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._on_desktop)
        self._show_switch()

    def _show_switch(self) -> None:
        dark = self.context.window.actions_table["dark"]
        with QSignalBlocker(dark):
            dark.setChecked(theme.is_dark(QApplication.palette()))

    def _show_about(self) -> None:
        show_and_focus(AboutWindow(self.context.document.path, self.context.window))

    def _set_dark(self, dark: bool) -> None:
        name = "dark" if dark else "light"
        if self.context.preferences["theme"] == name:  # the window was started with another theme
            self._apply_theme()
        self.context.preferences.set("theme", name)

    def _on_preference(self, key: str) -> None:
        if key == "theme":
            self._apply_theme()

    def _on_desktop(self) -> None:
        """Follows a change of the desktop's theme."""
        if self.context.preferences["theme"] == theme.SYSTEM:
            self._apply_theme()

    def _apply_theme(self) -> None:
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        theme.apply(app, str(self.context.preferences["theme"]))
        self._show_switch()

    ACTIONS = (
        Action("&Window", 0, "dark", "Dar&k theme", "Switch between dark and light", _set_dark, "Ctrl+T", icon="theme",
               check="on"),
        Action("&Window", 0, "fullscreen", "F&ull screen", "Use the whole screen",
               lambda self, on: self.context.window.showFullScreen() if on else self.context.window.showNormal(), "F11",
               icon="fullscreen", check="off"),
        Action("&Help", 1, "help", "&Help pages", "Read or search the help",
               lambda self: open_help("start", self.context.window), "F1", icon="help"),
        Action("&Help", 1, "help_keys", "&Keys and mouse", "Read how to move around and what the keys do",
               lambda self: open_help("keys", self.context.window), "Shift+F1"),
        Action("&Help", 2, "about", "&About NVSim", "Show the version and a system report to copy", _show_about),
    )  # fmt: skip


_SAID = 3000  # milliseconds that the status bar names the pane


class FocusPart(Part):
    """Commands that move to the next or previous pane. They use Ctrl+F6, because F6 walks as an agent."""

    def restore(self, settings: QSettings) -> None:
        self.ring = FocusRing(self.context.window)

    def panes(self) -> list[tuple[str, QWidget]]:
        """Title and widget of the visible panes, from left to right and from top to bottom."""
        window = self.context.window
        found: list[tuple[str, QWidget]] = [("3D view", window.center)] if window.center.isVisible() else []
        for name, title in window.dock_titles.items():
            panel = window.panels[name]
            if panel.isVisible() and _in_front(panel):
                found.append((title, panel))

        def place(pane: tuple[str, QWidget]) -> tuple[int, int]:
            corner = pane[1].mapTo(pane[1].window(), pane[1].rect().topLeft())
            return corner.x(), corner.y()

        return sorted(found, key=place)

    def step(self, by: int) -> None:
        """Moves the keyboard focus `by` panes further."""
        panes, focus = self.panes(), QApplication.focusWidget()
        if not panes:
            return
        here = [
            i for i, (_, pane) in enumerate(panes) if focus is not None and (pane is focus or pane.isAncestorOf(focus))
        ]
        index = (here[0] + by) % len(panes) if here else 0
        title, pane = panes[index]
        first = _first_control(pane)
        if first is not None:
            pane.window().activateWindow()
            first.setFocus(Qt.FocusReason.ShortcutFocusReason)
            self.context.window.statusBar().showMessage(title, _SAID)

    ACTIONS = (
        Action("&Window", 1, "next_pane", "&Next pane", "Focus the next panel or view", lambda self: self.step(1),
               "Ctrl+F6"),
        Action("&Window", 1, "previous_pane", "&Previous pane", "Focus the previous panel or view",
               lambda self: self.step(-1), "Ctrl+Shift+F6"),
    )  # fmt: skip


def _in_front(panel: QWidget) -> bool:
    """Whether a panel can be seen. For Qt, a panel behind another tab is visible, but outside the window."""
    window = panel.window()
    return window.rect().intersects(QRect(panel.mapTo(window, panel.rect().topLeft()), panel.size()))


def _first_control(pane: QWidget) -> QWidget | None:
    """The first control of a pane that accepts the keyboard focus."""
    each: QWidget | None = pane
    for _ in range(2000):
        if each is None or (each is not pane and not pane.isAncestorOf(each)):
            return None
        if each.focusPolicy() & Qt.FocusPolicy.TabFocus and each.isVisible() and each.isEnabled():
            return each
        each = each.nextInFocusChain()
    return None


_REMEMBERED = 12


class PalettePart(Part):
    """Opens the command palette and stores the recent commands."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._recent: list[str] = []
        self.view = PaletteView(self._matching_entries, context.window)
        self.view.ran.connect(self._on_ran)

    def restore(self, settings: QSettings) -> None:
        QShortcut(QKeySequence("Ctrl+Shift+P"), self.context.window, self.view.open)
        stored = settings.value("palette/recent", [])
        self._recent = [str(title) for title in stored] if isinstance(stored, list) else []

    def store(self, settings: QSettings) -> None:
        settings.setValue("palette/recent", self._recent)

    def _matching_entries(self, typed: str) -> list[PaletteEntry]:
        document = self.context.document
        own = [e for e in commands(self.context.window.actions_table, document) if e.title != "Command palette"]
        return [
            *matching_entries([*own, *self._panels(), *self._layers()], typed, self._recent),
            *places(document, typed, self._go_to_viewpoint, self._go_to_frame),
        ]

    def _panels(self) -> list[PaletteEntry]:
        """An entry for each panel, which shows it."""
        window = self.context.window
        return [
            PaletteEntry(f"Show panel {title}", "Window", "", "", partial(window.show_dock, name))
            for name, title in window.dock_titles.items()
        ]

    def _layers(self) -> list[PaletteEntry]:
        """An entry for each layer of the 3D view, which shows or hides it."""
        overlays = self.context.scene.overlays
        return [
            PaletteEntry(
                f"Layer {layer.title}{' (on)' if layer.shown else ' (off)'}", "View", "", "",
                partial(overlays.set_shown, layer.name, not layer.shown),
            )
            for layer in reversed(overlays.layers)
        ]  # fmt: skip

    def _go_to_viewpoint(self, id: str) -> None:
        arrays = self.context.document.graph_arrays
        self.context.document.select(viewpoint=id)
        self.context.scene.places.go_to_position(arrays.positions[arrays.index[id]])

    def _go_to_frame(self, frame: int) -> None:
        self.context.document.select(frame=frame)
        self.context.scene.places.snap_to_frame(frame)

    def _on_ran(self, entry: PaletteEntry) -> None:
        title = entry.title.removesuffix(" (on)").removesuffix(" (off)")
        if entry.place.startswith("Go to"):
            return
        self._recent = [title, *(t for t in self._recent if t != title)][:_REMEMBERED]

    ACTIONS = (
        Action("&Help", 0, "palette", "&Command palette…", "Find any command, viewpoint, or frame by a few letters",
               lambda self: self.view.open(), "Ctrl+P", icon="palette"),
    )  # fmt: skip


class PreferencePart(Part):
    """Opens the preferences and applies their values."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.dialog: PreferenceDialog | None = None
        self._ways: Mapping[int, tuple[int, int, int]] = ControlSettings().keys
        context.preferences.changed.connect(self._apply)

    def restore(self, settings: QSettings) -> None:
        self.bindings = KeyBindings(self.context.window.actions_table, settings, self._fly, self)
        for key in ("units", "mouse/", "mouse/flying", "job_threads"):
            self._apply(key)

    def open(self) -> PreferenceDialog:
        """Shows the dialog. There is only one."""
        if self.dialog is None or not isValid(self.dialog):
            self.dialog = PreferenceDialog(self.context.preferences, self.bindings, self.context.window)
        show_and_focus(self.dialog)
        return self.dialog

    def open_keys(self) -> PreferenceDialog:
        """Shows the dialog with the table of keys."""
        dialog = self.open()
        dialog.tabs.setCurrentWidget(dialog.keys)
        return dialog

    def _fly(self, ways: Mapping[int, tuple[int, int, int]]) -> None:
        self._ways = ways
        self._apply("mouse/")

    def _apply(self, key: str) -> None:
        set, navigation = self.context.preferences, self.context.scene.navigation
        if key == "units":
            lengths.choose(str(set["units"]))
            self.context.document.unitsChanged.emit()
            self.context.modes.refresh()
        elif key == "mouse/flying":
            navigation.speed = set.number(key)
        elif key.startswith("mouse/"):
            navigation.hands = ControlSettings(
                str(set["mouse/left"]),
                str(set["mouse/middle"]),
                str(set["mouse/right"]),
                bool(set["mouse/upside_down"]),
                bool(set["mouse/backwards"]),
                set.number("mouse/turning"),
                set.number("mouse/rolling"),
                self._ways,
            )
        elif key == "job_threads":
            self.context.jobs.threads = round(set.number(key))

    ACTIONS = (
        Action("&Edit", 90, "preferences", "Pre&ferences…", "Units, mouse, keys, saving, theme, memory, threads", open,
               "Ctrl+,"),
        Action("&Edit", 90, "preference_keys", "&Keys…",
               "Show all commands with their keys, change keys, and find conflicts", open_keys, "Ctrl+Alt+K"),
    )  # fmt: skip
