"""Going by key from pane to pane of the window: the panels that are in front, and what stands in the centre."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QRect, QSettings, Qt
from PySide6.QtWidgets import QApplication, QWidget

from app.actions import Action
from app.look.focus_ring import FocusRing
from app.wiring.part import Part

_SAID = 3000  # milliseconds for which the status bar names the pane


class PanePart(Part):
    """F6 itself stands at the selected viewpoint as an agent."""

    ACTIONS = (
        Action("next_pane", "&Next pane", "Give the keys to the next panel or view", "&Window", 1, "Ctrl+F6"),
        Action("previous_pane", "&Previous pane", "Give the keys to the panel or view before", "&Window", 1,
               "Ctrl+Shift+F6"),
    )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"next_pane": lambda: self.step(1), "previous_pane": lambda: self.step(-1)}

    def restore(self, settings: QSettings) -> None:
        self.ring = FocusRing(self.workspace.window)

    def panes(self) -> list[tuple[str, QWidget]]:
        """Title and widget of what is in front, from left to right and from top to bottom."""
        window = self.workspace.window
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
        """Gives the keys to the pane so many further."""
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
            self.workspace.window.statusBar().showMessage(title, _SAID)


def _in_front(panel: QWidget) -> bool:
    """Qt keeps a panel that stands behind another's tab shown, out of sight."""
    window = panel.window()
    return window.rect().intersects(QRect(panel.mapTo(window, panel.rect().topLeft()), panel.size()))


def _first(pane: QWidget) -> QWidget | None:
    """The first control of a pane that takes the keys."""
    each: QWidget | None = pane
    for _ in range(2000):
        if each is None or (each is not pane and not pane.isAncestorOf(each)):
            return None
        if each.focusPolicy() & Qt.FocusPolicy.TabFocus and each.isVisible() and each.isEnabled():
            return each
        each = each.nextInFocusChain()
    return None
