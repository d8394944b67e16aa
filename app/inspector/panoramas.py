"""The panoramas of viewpoints: asked for in the drawing process when one is looked at, or read from images beside a
graph; cached."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from app.drawing.panorama_child import WIDTHS, Panorama, PanoramaRequest
from app.drawing.render_link import RenderLink
from nvsim.errors import InputError

KEPT = 12  # sharp panoramas: 6 MB each
SKETCHES = 40  # coarse ones: 0.9 MB each
PATIENCE = 3000  # milliseconds of drawing until the user is told what may take so long
SETTLE = 120  # milliseconds: someone who steps through viewpoints does not have each drawn
Place = tuple[float, float, float]
Read = Callable[[], NDArray[np.uint8] | None]
"""Reads a panorama, (H, W, 4) as in Panorama.pixels; None where there is none."""


class Panoramas(QObject):
    """arrived(): `current` has become finer."""

    arrived = Signal()
    _was_read = Signal(object, object, str)  # from the thread that reads: the place, the pixels, what went wrong

    def __init__(self, link: RenderLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        self._kept: OrderedDict[Place, Panorama] = OrderedDict()
        self._sketches: OrderedDict[Place, Panorama] = OrderedDict()
        self._wanted: Place | None = None
        self._read: Read | None = None
        self._reader: threading.Thread | None = None
        self._troubles: dict[Place, str] = {}
        self._wait = QTimer(self, singleShot=True, interval=SETTLE)
        self._wait.timeout.connect(self._ask)
        self._patience = QTimer(self, singleShot=True, interval=PATIENCE)
        self._patience.timeout.connect(self.arrived)
        link.panoramaArrived.connect(self._on_panorama)
        self._was_read.connect(self._on_read)

    @property
    def current(self) -> Panorama | None:
        """The best there is of what is wanted."""
        if self._wanted is None:
            return None
        return self._kept.get(self._wanted) or self._sketches.get(self._wanted)

    @property
    def drawing(self) -> bool:
        """Whether a finer one is to come."""
        return self._wanted is not None and self._wanted not in self._kept and self._wanted not in self._troubles

    @property
    def words(self) -> str:
        """What is waited for."""
        slow = self.drawing and self._read is None and not self._patience.isActive()
        more = " The first one is slow: what draws it is compiled for this machine once." if slow else ""
        return f"Drawing the panorama…{more}"

    @property
    def trouble(self) -> str:
        """Why there is none of what is wanted; "" where there is, or may be soon."""
        return "" if self._wanted is None else self._troubles.get(self._wanted, "")

    def want(self, place: Place | None, read: Read | None = None) -> None:
        """The panorama from (x, y, z) is looked at now; None: nobody looks. With `read` it is read, not drawn."""
        if place == self._wanted:
            return
        self._wanted, self._read = place, read
        self._link.ask_panorama(None)
        if place is not None and place in self._kept:
            self._kept.move_to_end(place)
        elif place is not None:
            self._wait.start()
            self._patience.start()

    def close(self) -> None:
        """Waits for what is being read."""
        self._wanted = self._read = None
        self._patience.stop()
        if self._reader is not None:
            self._reader.join()

    def forget(self) -> None:
        """The models are others now: everything is to be drawn again."""
        self._kept.clear()
        self._sketches.clear()
        self._troubles.clear()
        if self._wanted is not None:
            self._wait.start()

    def _ask(self) -> None:
        if self._read is not None:
            if self.drawing and (self._reader is None or not self._reader.is_alive()):
                self._reader = threading.Thread(target=self._read_it, args=(self._wanted, self._read), daemon=True)
                self._reader.start()
        elif self._wanted is not None:
            known = self._wanted in self._sketches
            self._link.ask_panorama(PanoramaRequest(self._wanted, self._wanted, WIDTHS[1:] if known else WIDTHS))

    def _read_it(self, place: Place, read: Read) -> None:
        try:
            self._was_read.emit(place, read(), "")
        except InputError as error:
            self._was_read.emit(place, None, str(error))

    def _on_read(self, place: Place, pixels: NDArray[np.uint8] | None, trouble: str) -> None:
        if pixels is not None:
            self._on_panorama(Panorama(place, pixels.shape[1], {"rgb": pixels}, -1, 0.0, True))
        else:
            self._troubles[place] = trouble or "There is no image of this viewpoint beside the file."
            self.arrived.emit()
        self._wait.start()  # another one may be wanted by now

    def _on_panorama(self, panorama: Panorama) -> None:
        place = panorama.key
        assert isinstance(place, tuple)
        store, most = (self._kept, KEPT) if panorama.final else (self._sketches, SKETCHES)
        store[place] = panorama
        store.move_to_end(place)
        while len(store) > most:
            store.popitem(last=False)
        if place == self._wanted:
            self.arrived.emit()
