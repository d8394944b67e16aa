"""Python's garbage collector, run only at moments in which the user does not feel it.

Left alone it runs whenever enough was made, in whichever thread that happens, and walks through everything there is:
a graph of ten thousand viewpoints costs 90 ms each time, several times while it is read, and no thread goes on
meanwhile. Here it does not run by itself. What was read stays, so it is put aside (gc.freeze) and never walked through;
what is young is looked at now and then, and everything when another project takes the place of one.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer

PERIOD = 1000  # milliseconds between two looks
YOUNG = 2_000  # objects made, more than went, since the last look: a walk through them takes 1 ms
MANY = 40_000  # so many since the last look are something large that was read
THOROUGH = 30  # looks, until everything that is not aside is looked at, while nothing moves


class Collecting(QObject):
    """Takes the collector over until `stop`.

    moving   whether the user would feel a pause of some 20 ms now
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
        """What was put aside is of no use any more: to be called when a project is left, before one is read."""
        self._anew.start()  # once everybody has let go of it

    def look(self) -> None:
        """Frees what is young and hangs in a circle; now and then all that is not aside, where nothing moves."""
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
        gc.freeze()  # the window itself

    def stop(self) -> None:
        """The collector runs by itself again."""
        self._timer.stop()
        self._anew.stop()
        gc.unfreeze()
        gc.enable()
