"""Caches the positions of recent live views with their drawn tiles, so that a turn on the spot draws only new parts."""

from __future__ import annotations

import threading
from collections import OrderedDict

from nvsim.geometry.camera import Camera
from nvsim.r2r.observations.growing import GrowingSurround
from nvsim.render.kernel_types import Float32
from nvsim.splats.types import SubmapModel

MEMORY = 1 << 30
"""Largest memory of the cache in bytes. The position of the current view is always kept."""
FINER = 1.08
"""Resolution of the narrow views relative to the center of a view. For 640 x 480 pixels and 60 degrees, the focal
lengths are 448 and 416 pixels. Strips with faces of 512 pixels are made from 512."""
_STEP = 32  # pixels; views of similar size share narrow views


class PlacesSeen:
    """A thread-safe cache of `GrowingSurround`s."""

    def __init__(self, memory: int = MEMORY) -> None:
        self._memory, self._lock = memory, threading.Lock()
        self._places: OrderedDict[tuple[float, ...], GrowingSurround] = OrderedDict()

    def image(self, model: SubmapModel, camera: Camera, solid: bool) -> tuple[Float32, Float32]:
        """Returns `GrowingSurround.image` at the position of `camera`.

        The results are (H, W, 3) float32 colors from 0 to 255, and, if `solid` is true, (H, W, 2) alpha and alpha times
        meters.
        """
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
        """Removes all positions."""
        with self._lock:
            self._places.clear()
