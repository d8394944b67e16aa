"""Renewing a panel once things have settled, and only while it can be seen.

A dock behind another tab counts as visible to Qt, and no show event comes when its tab is chosen; but what cannot be
seen has no visible region, and a panel that comes to the front is painted.
"""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, QTimer
from PySide6.QtWidgets import QWidget


class Afterwards(QObject):
    """Calls `renew` some milliseconds after the last `mark`, or when the panel comes into sight."""

    def __init__(self, panel: QWidget, renew: Callable[[], object], milliseconds: int) -> None:
        super().__init__(panel)
        self._panel, self._renew = panel, renew
        self._stale = False
        self._timer = QTimer(self, singleShot=True, interval=milliseconds)
        self._timer.timeout.connect(self._fire)
        panel.installEventFilter(self)

    @property
    def in_sight(self) -> bool:
        return self._panel.isVisible() and not self._panel.visibleRegion().isEmpty()

    def mark(self, _: object = None) -> None:
        """What the panel shows is out of date."""
        self._stale = True
        if self.in_sight:
            self._timer.start()

    def done(self) -> None:
        """It was renewed by other means."""
        self._stale = False
        self._timer.stop()

    def _fire(self) -> None:
        if self._stale and self.in_sight:
            self._stale = False
            self._renew()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and self._stale and not self._timer.isActive():
            self._timer.start()
        return False
