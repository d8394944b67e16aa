"""The places from which live views were drawn lately, with what was drawn there: to turn on the spot draws only what
comes into view."""

from __future__ import annotations

import threading
from collections import OrderedDict

from nvsim.geometry.camera import Camera
from nvsim.r2r.observations.growing import GrowingSurround
from nvsim.render.kernel_types import Float32
from nvsim.splats.types import SubmapModel

MEMORY = 1 << 30
"""Bytes that they may take together; the place where a view is drawn is kept in any case."""
FINER = 1.08
"""Pixels of the narrow views for each of a view's middle: 448 to the unit for 640 x 480 and 60 degrees, which have 416;
strips of 512 are made from 512."""
_STEP = 32  # pixels: views of nearly the same size share narrow views


class PlacesSeen:
    """Safe to be asked by several threads."""

    def __init__(self, memory: int = MEMORY) -> None:
        self._memory, self._lock = memory, threading.Lock()
        self._places: OrderedDict[tuple[float, ...], GrowingSurround] = OrderedDict()

    def image(self, model: SubmapModel, camera: Camera, solid: bool) -> tuple[Float32, Float32]:
        """As `GrowingSurround.image`, of the place where `camera` stands; alpha and distances where `solid`."""
        focal = _STEP * round(FINER * camera.intrinsics.fx / _STEP + 0.3)
        key = (*camera.position.tolist(), focal, solid)
        with self._lock:
            place = self._places.get(key)
            if place is None:
                place = self._places[key] = GrowingSurround(camera.position, focal, solid)
            self._places.move_to_end(key)
            while len(self._places) > 1 and sum(p.bytes for p in self._places.values()) > self._memory:
                self._places.popitem(last=False)
            return place.image(model, camera)

    def clear(self) -> None:
        """Lets go of all of them."""
        with self._lock:
            self._places.clear()
