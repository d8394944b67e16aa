"""Commands of the whole window: theme, full screen, help pages, keyboard focus, command palette, and preferences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from PySide6.QtCore import QRect, QSettings, Qt
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


_SAID = 3000  # milliseconds that the status bar names the pane


class FocusPart(Part):
    """Commands that move to the next or previous pane. They use Ctrl+F6, because F6 walks as an agent."""

    ACTIONS = (
        Action("next_pane", "&Next pane", "Focus the next panel or view", "&Window", 1, "Ctrl+F6"),
        Action("previous_pane", "&Previous pane", "Focus the previous panel or view", "&Window", 1, "Ctrl+Shift+F6"),
    )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"next_pane": lambda: self.step(1), "previous_pane": lambda: self.step(-1)}

    def restore(self, settings: QSettings) -> None:
        self.ring = FocusRing(self.context.window)

    def panes(self) -> list[tuple[str, QWidget]]:
        """Title and widget of the visible panes, from left to right and from top to bottom."""
        window = self.context.window
        found: list[tuple[str, QWidget]] = [("3D view", window.centre)] if window.centre.isVisible() else []
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

    ACTIONS = (
        Action("palette", "&Command palette…", "Find any command, viewpoint, or frame by a few letters", "&Help", 0,
               "Ctrl+P", "palette"),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._recent: list[str] = []
        self.view = PaletteView(self._matching_entries, context.window)
        self.view.ran.connect(self._on_ran)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"palette": self.view.open}

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
        self.context.scene.go_to_position(arrays.positions[arrays.index[id]])

    def _go_to_frame(self, frame: int) -> None:
        self.context.document.select(frame=frame)
        self.context.scene.snap_to_frame(frame)

    def _on_ran(self, entry: PaletteEntry) -> None:
        title = entry.title.removesuffix(" (on)").removesuffix(" (off)")
        if entry.place.startswith("Go to"):
            return
        self._recent = [title, *(t for t in self._recent if t != title)][:_REMEMBERED]


class PreferencePart(Part):
    """Opens the preferences and applies their values."""

    ACTIONS = (
        Action("preferences", "Pre&ferences…", "Units, mouse, keys, saving, theme, memory, threads", "&Edit", 90,
               "Ctrl+,"),
        Action("preference_keys", "&Keys…", "Show all commands with their keys, change keys, and find conflicts",
               "&Edit", 90, "Ctrl+Alt+K"),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.dialog: PreferenceDialog | None = None
        self._ways: Mapping[int, tuple[int, int, int]] = ControlSettings().keys
        context.preferences.changed.connect(self._apply)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"preferences": self.open, "preference_keys": self.open_keys}

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
