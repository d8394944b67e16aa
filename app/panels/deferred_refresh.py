"""Renewing a panel once things have settled, only while it can be seen, and in slices that nobody feels.

A dock behind another tab counts as visible to Qt, and no show event comes when its tab is chosen; but what cannot be
seen has no visible region, and a panel that comes to the front is painted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from PySide6.QtCore import QEvent, QObject, QTimer
from PySide6.QtWidgets import QWidget

SLICE = 0.006  # seconds of the event loop at a time


class DeferredRefresh(QObject):
    """Calls `renew` some milliseconds after the last `mark`, or when the panel comes into sight. What `renew` gives to
    iterate over is gone through a slice at a time, and given up when the panel is marked again."""

    def __init__(self, panel: QWidget, renew: Callable[[], Iterator[object] | None], milliseconds: int) -> None:
        super().__init__(panel)
        self._panel, self._renew = panel, renew
        self._stale = False
        self._timer = QTimer(self, singleShot=True, interval=milliseconds)
        self._timer.timeout.connect(self._fire)
        self._steps: Iterator[object] | None = None
        self._slices = QTimer(self, singleShot=True, interval=1)
        self._slices.timeout.connect(self._go_on)
        panel.installEventFilter(self)

    @property
    def in_sight(self) -> bool:
        return self._panel.isVisible() and not self._panel.visibleRegion().isEmpty()

    def mark(self, _: object = None) -> None:
        """What the panel shows is out of date."""
        self._stale = True
        self._give_up()
        if self.in_sight:
            self._timer.start()

    def done(self) -> None:
        """It was renewed by other means."""
        self._stale = False
        self._timer.stop()
        self._give_up()

    def _give_up(self) -> None:
        self._steps = None
        self._slices.stop()

    def _fire(self) -> None:
        if self._stale and self.in_sight:
            self._stale = False
            self._steps = self._renew()
            self._go_on()

    def _go_on(self) -> None:
        until = time.perf_counter() + SLICE
        while (steps := self._steps) is not None:
            if next(steps, self) is self:
                self._steps = None
            elif time.perf_counter() > until:
                self._slices.start()
                return

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and self._stale and not self._timer.isActive():
            self._timer.start()
        return False
