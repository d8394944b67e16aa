"""The commands of the window in one table, from which menus, toolbar and shortcuts are built.

A command that cannot run now says why: its reason stands in the tool tip and in the status bar.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QActionGroup, QKeySequence, QPalette
from PySide6.QtWidgets import QMenu, QMenuBar, QToolBar

from app.look.icons import icon
from app.look.plain_text import plain, tip
from app.state.document import Document
from app.state.reasons import Reason, always

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

    id         also the key of its handler
    menu       the menu it stands in, one of MENUS; sections stand in the order of their numbers between separators
    check      "" for a plain command, "on" or "off" for a switch and its first state
    group      switches of one group exclude each other
    toolbar    whether it has a button
    """

    id: str
    text: str
    tip: str
    menu: str
    section: int = 0
    shortcut: str = ""
    icon: str = ""
    check: str = ""
    group: str = ""
    toolbar: bool = False
    enabled: Callable[[Document], Reason] = always


class ActionTable(QObject):
    """The QActions of the table; they are enabled or disabled as the document changes."""

    def __init__(
        self,
        document: Document,
        actions: Iterable[Action],
        handlers: Mapping[str, Callable[..., object]],
        parent: QObject,
    ) -> None:
        """Raises KeyError when an action has no handler, ValueError when its menu is unknown."""
        super().__init__(parent)
        self._document = document
        # Several parts put their commands into one menu: its sections come together here.
        self.entries = sorted(actions, key=lambda a: (MENUS.index(a.menu), a.section))
        self.actions: dict[str, QAction] = {}
        self._reasons: dict[str, Reason] = {}
        groups: dict[str, QActionGroup] = {}
        for entry in self.entries:
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
            (action.toggled if entry.check and not entry.group else action.triggered).connect(handlers[entry.id])
            self.actions[entry.id] = action
        document.contentsChanged.connect(self.refresh)
        document.selectionChanged.connect(self.refresh)
        document.pageChanged.connect(self.refresh)
        document.editing.stepsChanged.connect(self.refresh)
        self.refresh()

    def __getitem__(self, id: str) -> QAction:
        return self.actions[id]

    def refresh(self) -> None:
        """Asks every action whether it can run."""
        for entry in self.entries:
            action, reason = self.actions[entry.id], entry.enabled(self._document)
            if self._reasons.get(entry.id, "") == reason:
                continue  # setting tips costs more than asking
            self._reasons[entry.id] = reason
            action.setEnabled(reason is None)
            keys = self.keys(entry.id)
            shortcut = f" ({keys})" if keys else ""
            reason_words = (reason or "").rstrip(".")
            not_now = "" if reason is None else f"Not now: {reason_words}."
            action.setToolTip(tip(f"{entry.tip}{shortcut}\n{not_now}".rstrip()))
            action.setStatusTip(plain(f"{entry.tip}. {not_now}" if not_now else entry.tip))

    def keys(self, id: str) -> str:
        """The shortcut of a command, "" for none."""
        return self.actions[id].shortcut().toString()

    def bind(self, id: str, keys: str) -> None:
        """Gives a command another shortcut, "" for none."""
        self.actions[id].setShortcut(QKeySequence(keys))
        self._reasons.pop(id, None)  # the tool tip names the shortcut
        self.refresh()

    def why_not(self, keys: QKeySequence) -> str:
        """Why the command of these keys cannot run now, as a sentence; "" where there is none, or it can."""
        for entry in self.entries:
            reason = self._reasons.get(entry.id)
            if reason and not keys.isEmpty() and self.actions[entry.id].shortcut() == keys:
                return f"{entry.text.replace('&', '').rstrip('…')}: not now, {reason}."
        return ""

    def dress(self, palette: QPalette) -> None:
        """Draws the icons in the colours of `palette`."""
        for entry in self.entries:
            if entry.icon:
                self.actions[entry.id].setIcon(icon(entry.icon, palette))

    def fill_menus(self, bar: QMenuBar) -> dict[str, QMenu]:
        """Makes the menus; returns them by title."""
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
