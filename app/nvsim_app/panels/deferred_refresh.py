"""Updates a panel after a pause, only while it is visible, and in short slices that do not block the window.

To Qt, a dock behind another tab is visible, and it gets no show event when its tab is selected. Two facts help: a
hidden panel has an empty visible region, and a panel that comes to the front is painted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from PySide6.QtCore import QEvent, QObject, QTimer
from PySide6.QtWidgets import QWidget

from nvsim_app.state.document import Document

SLICE = 0.006  # seconds of work in one turn of the event loop


class DeferredRefresh(QObject):
    """Calls `renew` some milliseconds after the last `mark`, or when the panel becomes visible.

    If `renew` returns an iterator, the iterator is advanced in slices. Another `mark` cancels it.
    """

    def __init__(self, panel: QWidget, renew: Callable[[], Iterator[object] | None], milliseconds: int) -> None:
        super().__init__(panel)
        self._panel, self._renew = panel, renew
        self._stale = False
        self._timer = QTimer(self, singleShot=True, interval=milliseconds)
        self._timer.timeout.connect(self._refresh_if_visible)
        self._steps: Iterator[object] | None = None
        self._slices = QTimer(self, singleShot=True, interval=1)
        self._slices.timeout.connect(self._go_on)
        panel.installEventFilter(self)

    @property
    def in_sight(self) -> bool:
        return self._panel.isVisible() and not self._panel.visibleRegion().isEmpty()

    @property
    def is_outdated(self) -> bool:
        """Whether the panel does not show the newest state yet."""
        return self._stale or self._steps is not None

    def mark(self, _: object = None) -> None:
        """Marks the panel as out of date."""
        self._stale = True
        self._give_up()
        if self.in_sight:
            self._timer.start()

    def refresh_after_edits_of(self, document: Document) -> None:
        """Marks the panel whenever the graph changes."""
        document.graphChanged.connect(self.mark)
        document.contentsChanged.connect(self._on_contents)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self.mark()

    def finish(self, _: object = None) -> None:
        """Updates the panel at once."""
        self.cancel()
        for _ in self._renew() or ():
            pass

    def cancel(self) -> None:
        """Cancels the pending update, because the panel was updated by other means."""
        self._stale = False
        self._timer.stop()
        self._give_up()

    def _give_up(self) -> None:
        self._steps = None
        self._slices.stop()

    def _refresh_if_visible(self) -> None:
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
