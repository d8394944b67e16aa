"""The preferences: the dialog, and the effect of each value on the window. Other parts apply the theme, the renderer,
the splat budget, and automatic saving."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from app.actions import Action
from app.look import lengths
from app.look.front import bring_up
from app.panels.key_bindings import KeyBindings
from app.panels.preference_dialog import PreferenceDialog
from app.views.hands import Hands
from app.wiring.part import Part, WindowContext


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
        self._ways: Mapping[int, tuple[int, int, int]] = Hands().keys
        context.preferences.changed.connect(self._apply)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"preferences": self.open, "preference_keys": self.open_keys}

    def restore(self, settings: QSettings) -> None:
        self.bindings = KeyBindings(self.context.window.actions_table, settings, self._fly, self)
        for key in ("units", "mouse/", "mouse/flying", "job_threads"):
            self._apply(key)

    def open(self) -> PreferenceDialog:
        """Shows the dialog. There is only one."""
        if self.dialog is None:
            self.dialog = PreferenceDialog(self.context.preferences, self.bindings, self.context.window)
            self.dialog.destroyed.connect(self._forget)
        bring_up(self.dialog)
        return self.dialog

    def open_keys(self) -> PreferenceDialog:
        """Shows the dialog with the table of keys."""
        dialog = self.open()
        dialog.tabs.setCurrentWidget(dialog.keys)
        return dialog

    def _forget(self) -> None:
        self.dialog = None

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
            navigation.hands = Hands(
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
