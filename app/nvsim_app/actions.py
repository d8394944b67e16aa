"""The commands of the window in one table, from which the menus, toolbar, and shortcuts are built.

A disabled command shows the reason in its tooltip and in the status bar.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QActionGroup, QKeySequence, QPalette
from PySide6.QtWidgets import QMenu, QMenuBar, QToolBar

from nvsim_app.look.icons import icon
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, never_disabled

MENUS = (
    "&File",
    "&Edit",
    "&Camera",
    "&View",
    "F&rame",
    "&Graph",
    "&Jobs",
    "&Window",
    "&Help",
)  # in the order of the bar


@dataclass(frozen=True)
class Action:
    """One command.

    menu       one of MENUS
    section    commands of one menu are grouped by section, in ascending order, with separators between sections
    id         name of the command
    run        called with the part of the window that has the command, and with the new state if the command is
               checkable and has no group
    enabled    reason why the command is disabled, or None
    check      "" for a plain command, "on" or "off" for a checkable command and its initial state
    group      commands of one group exclude each other
    toolbar    whether the toolbar has a button for it
    """

    menu: str
    section: int
    id: str
    text: str
    tip: str
    run: Callable[..., object]
    shortcut: str = ""
    enabled: Callable[[Document], Reason] = never_disabled
    icon: str = ""
    check: str = ""
    group: str = ""
    toolbar: bool = False


class ActionTable(QObject):
    """The QActions of the table. They are enabled or disabled when the document changes."""

    def __init__(self, document: Document, actions: Iterable[tuple[Action, object]], parent: QObject) -> None:
        """`actions` has every command with its part. Raises ValueError if a menu is unknown."""
        super().__init__(parent)
        self._document = document
        # Several parts add commands to one menu. Sorting groups its sections.
        rows = sorted(actions, key=lambda row: (MENUS.index(row[0].menu), row[0].section))
        self.entries = [entry for entry, _ in rows]
        self.actions: dict[str, QAction] = {}
        self._reasons: dict[str, Reason] = {}
        groups: dict[str, QActionGroup] = {}
        for entry, part in rows:
            action = QAction(entry.text, self)
            action.setObjectName(entry.id)
            if entry.shortcut:
                action.setShortcut(QKeySequence(entry.shortcut))
            if entry.check:
                action.setCheckable(True)
                action.setChecked(entry.check == "on")
            if entry.group:
                if entry.group not in groups:
                    groups[entry.group] = QActionGroup(self)
                groups[entry.group].addAction(action)
            run = partial(entry.run, part)
            if entry.check and not entry.group:
                action.toggled.connect(run)
            else:
                action.triggered.connect(lambda _, run=run: run())
            self.actions[entry.id] = action
        document.contentsChanged.connect(self.refresh)
        document.selectionChanged.connect(self.refresh)
        document.pageChanged.connect(self.refresh)
        document.editing.stepsChanged.connect(self.refresh)
        self.refresh()

    def __getitem__(self, id: str) -> QAction:
        return self.actions[id]

    def refresh(self) -> None:
        """Enables or disables every action and updates its tooltip."""
        for entry in self.entries:
            action, reason = self.actions[entry.id], entry.enabled(self._document)
            if self._reasons.get(entry.id, "") == reason:
                continue  # setting the tooltips costs more than this comparison
            self._reasons[entry.id] = reason
            action.setEnabled(reason is None)
            keys = self.keys(entry.id)
            shortcut = f" ({keys})" if keys else ""
            reason_words = (reason or "").rstrip(".")
            not_now = "" if reason is None else f"Unavailable: {reason_words}."
            action.setToolTip(tooltip_text(f"{entry.tip}{shortcut}\n{not_now}".rstrip()))
            action.setStatusTip(plain(f"{entry.tip}. {not_now}" if not_now else entry.tip))

    def keys(self, id: str) -> str:
        """The shortcut of a command, or "" if it has none."""
        return self.actions[id].shortcut().toString()

    def bind(self, id: str, keys: str) -> None:
        """Sets the shortcut of a command; "" removes it."""
        self.actions[id].setShortcut(QKeySequence(keys))
        self._reasons.pop(id, None)  # the tooltip names the shortcut
        self.refresh()

    def why_not(self, keys: QKeySequence) -> str:
        """The reason, as a sentence, why the command of this shortcut is disabled; "" if it is enabled or unknown."""
        for entry in self.entries:
            reason = self._reasons.get(entry.id)
            if reason and not keys.isEmpty() and self.actions[entry.id].shortcut() == keys:
                return f"{entry.text.replace('&', '').rstrip('…')}: unavailable, {reason}."
        return ""

    def apply_palette(self, palette: QPalette) -> None:
        """Draws the icons in the colors of `palette`."""
        for entry in self.entries:
            if entry.icon:
                self.actions[entry.id].setIcon(icon(entry.icon, palette))

    def fill_menus(self, bar: QMenuBar) -> dict[str, QMenu]:
        """Creates the menus and returns them by title."""
        menus: dict[str, QMenu] = {}
        section: dict[str, int] = {}
        for entry in self.entries:
            if entry.menu not in menus:
                menu = bar.addMenu(entry.menu)
                menu.setToolTipsVisible(True)
                menus[entry.menu], section[entry.menu] = menu, entry.section
            if entry.section != section[entry.menu]:
                menus[entry.menu].addSeparator()
                section[entry.menu] = entry.section
            menus[entry.menu].addAction(self.actions[entry.id])
        return menus

    def fill_toolbar(self, bar: QToolBar) -> None:
        last: tuple[str, int] | None = None
        for entry in self.entries:
            if not entry.toolbar:
                continue
            if last is not None and last != (entry.menu, entry.section):
                bar.addSeparator()
            last = (entry.menu, entry.section)
            bar.addAction(self.actions[entry.id])
