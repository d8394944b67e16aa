"""The panoramas of viewpoints: asked for in the drawing process when one is looked at, kept for a while."""

from __future__ import annotations

from collections import OrderedDict

from PySide6.QtCore import QObject, QTimer, Signal

from app.panorama_child import WIDTHS, Panorama, PanoramaRequest
from app.render_link import RenderLink

KEPT = 12  # sharp panoramas: 6 MB each
SKETCHES = 40  # coarse ones: 0.9 MB each
SETTLE = 120  # milliseconds: someone who steps through viewpoints does not have each drawn
Place = tuple[float, float, float]


class Panoramas(QObject):
    """arrived(): `current` has become finer."""

    arrived = Signal()

    def __init__(self, link: RenderLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        self._kept: OrderedDict[Place, Panorama] = OrderedDict()
        self._sketches: OrderedDict[Place, Panorama] = OrderedDict()
        self._wanted: Place | None = None
        self._wait = QTimer(self, singleShot=True, interval=SETTLE)
        self._wait.timeout.connect(self._ask)
        link.panoramaArrived.connect(self._on_panorama)

    @property
    def current(self) -> Panorama | None:
        """The best there is of what is wanted."""
        if self._wanted is None:
            return None
        return self._kept.get(self._wanted) or self._sketches.get(self._wanted)

    @property
    def drawing(self) -> bool:
        """Whether a finer one is to come."""
        return self._wanted is not None and self._wanted not in self._kept

    def want(self, place: Place | None) -> None:
        """The panorama from (x, y, z) is looked at now; None: nobody looks."""
        if place == self._wanted:
            return
        self._wanted = place
        self._link.ask_panorama(None)
        if place is not None and place in self._kept:
            self._kept.move_to_end(place)
        elif place is not None:
            self._wait.start()

    def forget(self) -> None:
        """The models are others now: everything is to be drawn again."""
        self._kept.clear()
        self._sketches.clear()
        if self._wanted is not None:
            self._wait.start()

    def _ask(self) -> None:
        if self._wanted is not None:
            known = self._wanted in self._sketches
            self._link.ask_panorama(PanoramaRequest(self._wanted, self._wanted, WIDTHS[1:] if known else WIDTHS))

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
