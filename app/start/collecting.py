"""Runs Python's garbage collector only when the user does not notice the pause.

By default, the collector runs after a number of allocations, in any thread, and visits all objects. With a graph of ten
thousand viewpoints this stops all threads for 90 ms, several times while the graph is read. Here the automatic
collection is disabled. Loaded data is frozen (gc.freeze) and never visited, young objects are collected regularly, and
everything is collected when the project changes.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer

PERIOD = 1000  # milliseconds between two checks
YOUNG = 2_000  # net number of new objects that triggers a collection of young objects, which takes 1 ms
MANY = 40_000  # net number of new objects that indicates loaded data, which is frozen
THOROUGH = 30  # number of checks until all objects that are not frozen are collected, if nothing moves


class Collecting(QObject):
    """Controls the garbage collector until `stop`.

    moving   returns whether the user would notice a pause of 20 ms now
    """

    def __init__(self, moving: Callable[[], bool], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._moving = moving
        self._looks = 0
        gc.disable()
        gc.freeze()
        self._timer = QTimer(self, interval=PERIOD)
        self._timer.timeout.connect(self.look)
        self._timer.start()
        self._anew = QTimer(self, singleShot=True, interval=0)
        self._anew.timeout.connect(self._clear)

    def begin_anew(self) -> None:
        """Collects everything, including frozen objects. Call it when a project is closed, before another is read."""
        self._anew.start()  # after all references are released

    def look(self) -> None:
        """Freezes loaded data or collects objects, depending on the number of new objects and on movement."""
        made = gc.get_count()[0]
        self._looks += 1
        if made > MANY:
            gc.freeze()
        elif self._looks >= THOROUGH and not self._moving():
            self._looks = 0
            gc.collect()
        elif made > YOUNG:
            gc.collect(1)

    def _clear(self) -> None:
        gc.unfreeze()
        gc.collect()
        gc.freeze()  # the objects of the window

    def stop(self) -> None:
        """Enables the automatic collection again."""
        self._timer.stop()
        self._anew.stop()
        gc.unfreeze()
        gc.enable()
