"""The panoramas of viewpoints: rendered on request in the rendering process, or read from images beside a graph file;
cached."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from nvsim.kernel_folder import compiled_since
from nvsim_app.drawing.panorama_child import WIDTHS, Panorama, PanoramaRequest
from nvsim_app.drawing.picture_feed import RenderLink
from nvsim_app.processes.background import BackgroundWork

KEPT = 12  # cached sharp panoramas, 6 MB each
SKETCHES = 40  # cached coarse panoramas, 0.9 MB each
PATIENCE = 3000  # milliseconds of rendering until a check whether kernels are being compiled
SETTLE = 120  # milliseconds until the request, so that quick steps through viewpoints do not render each of them
Place = tuple[float, float, float]
Read = Callable[[], NDArray[np.uint8] | None]
"""Reads a panorama, (H, W, 4) uint8 as in Panorama.pixels; None if there is none."""


class Panoramas(QObject):
    """Requests, reads, and caches panoramas. arrived(): `current` or its note changed."""

    arrived = Signal()

    def __init__(self, link: RenderLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        self._kept: OrderedDict[Place, Panorama] = OrderedDict()
        self._sketches: OrderedDict[Place, Panorama] = OrderedDict()
        self._wanted: Place | None = None
        self._read: Read | None = None
        self._reading = BackgroundWork("panorama", self)
        self._troubles: dict[Place, str] = {}
        self._wait = QTimer(self, singleShot=True, interval=SETTLE)
        self._wait.timeout.connect(self._ask)
        self._patience = QTimer(self, singleShot=True, interval=PATIENCE)
        self._patience.timeout.connect(self._explain)
        self._asked = 0.0  # when the panorama was requested, seconds since the epoch
        self._compiles = False  # whether kernels were compiled since then
        link.panoramaArrived.connect(self._on_panorama)

    @property
    def current(self) -> Panorama | None:
        """The finest available panorama of the requested position."""
        if self._wanted is None:
            return None
        return self._kept.get(self._wanted) or self._sketches.get(self._wanted)

    @property
    def drawing(self) -> bool:
        """Whether a finer panorama will come."""
        return self._wanted is not None and self._wanted not in self._kept and self._wanted not in self._troubles

    @property
    def words(self) -> str:
        """The note that is shown while the panorama is rendered."""
        slow = self.drawing and self._read is None and self._compiles
        more = " The first one is slow, because the renderer is compiled once on this machine." if slow else ""
        return f"Rendering the panorama…{more}"

    def _explain(self) -> None:
        self._compiles = compiled_since(self._asked)
        self.arrived.emit()

    @property
    def failure_reason(self) -> str:
        """Why the requested panorama is not available; "" if it is, or if it may come."""
        return "" if self._wanted is None else self._troubles.get(self._wanted, "")

    def request(self, place: Place | None, read: Read | None = None) -> None:
        """Requests the panorama at `place` (x, y, z) in meters, world; None requests none. With `read` it is read from
        a file instead of rendered."""
        if place == self._wanted:
            return
        self._wanted, self._read = place, read
        self._link.ask_panorama(None)
        if place is not None and place in self._kept:
            self._kept.move_to_end(place)
        elif place is not None:
            self._wait.start()
            self._asked, self._compiles = time.time(), False
            self._patience.start()

    def close(self) -> None:
        """Cancels the request, and waits for the reading thread."""
        self._wanted = self._read = None
        self._patience.stop()
        self._reading.stop()

    def clear_caches(self) -> None:
        """Empties the caches and repeats the request, because the models changed."""
        self._kept.clear()
        self._sketches.clear()
        self._troubles.clear()
        if self._wanted is not None:
            self._wait.start()

    def _ask(self) -> None:
        place = self._wanted
        if place is None:
            return
        if self._read is None:
            widths = WIDTHS[1:] if place in self._sketches else WIDTHS
            self._link.ask_panorama(PanoramaRequest(place, place, widths))
        elif self.drawing and not self._reading.busy:
            self._reading.start(self._read, partial(self._on_read, place), partial(self._on_read, place, None))

    def _on_read(self, place: Place, pixels: NDArray[np.uint8] | None, trouble: str = "") -> None:
        if pixels is not None:
            self._on_panorama(Panorama(place, pixels.shape[1], {"rgb": pixels}, -1, 0.0, True))
        else:
            self._troubles[place] = trouble or "The folder of the file has no image of this viewpoint."
            self.arrived.emit()
        self._wait.start()  # another panorama may be requested meanwhile

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
