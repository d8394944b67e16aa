"""Moves the keyboard focus between the panes of the window: the panels in front, and the center."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QRect, QSettings, Qt
from PySide6.QtWidgets import QApplication, QWidget

from app.actions import Action
from app.look.focus_ring import FocusRing
from app.wiring.part import Part

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
        first = _first(pane)
        if first is not None:
            pane.window().activateWindow()
            first.setFocus(Qt.FocusReason.ShortcutFocusReason)
            self.context.window.statusBar().showMessage(title, _SAID)


def _in_front(panel: QWidget) -> bool:
    """Whether a panel can be seen. For Qt, a panel behind another tab is visible, but outside the window."""
    window = panel.window()
    return window.rect().intersects(QRect(panel.mapTo(window, panel.rect().topLeft()), panel.size()))


def _first(pane: QWidget) -> QWidget | None:
    """The first control of a pane that accepts the keyboard focus."""
    each: QWidget | None = pane
    for _ in range(2000):
        if each is None or (each is not pane and not pane.isAncestorOf(each)):
            return None
        if each.focusPolicy() & Qt.FocusPolicy.TabFocus and each.isVisible() and each.isEnabled():
            return each
        each = each.nextInFocusChain()
    return None
