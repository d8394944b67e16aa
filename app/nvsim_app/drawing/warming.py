"""Compiles the render kernels in the rendering process before the user needs them. The first time on a machine this
takes half a minute; afterward the cache is read quickly. Does not use Qt."""

from __future__ import annotations

import time

import numpy as np

from nvsim.geometry.camera import Camera, Intrinsics
from nvsim_app.drawing.painter import Painter
from nvsim_app.drawing.panorama_child import PanoramaDrawing, PanoramaRequest
from nvsim_app.drawing.renderer_choice import CPU

COLD = 3.0  # seconds; if the first image took longer, its kernels were compiled
_EYE = np.eye(4)
_SIDE = 32  # pixels


class Warming:
    """Compiles the kernels of all images first, then, between requests, the additional kernels of panoramas."""

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._panorama = PanoramaDrawing(painter.look_around)

    @property
    def has_waiting_kernels(self) -> bool:
        """Whether kernels of panoramas may remain to be compiled."""
        return self._panorama.has_waiting_views

    def begin(self) -> None:
        """Renders a small image. If that was slow because of compilation, panoramas are compiled immediately too, so
        that the user waits only once."""
        begin = time.perf_counter()
        self._painter.paint(Camera(Intrinsics.from_fov(_SIDE, _SIDE, 1.0), _EYE), "rgb", CPU, moving=True)
        if not self._painter.by_kernels:
            return
        self._panorama.begin(PanoramaRequest("warming", (0.0, 0.0, 0.0), (2 * _SIDE,)))
        while time.perf_counter() - begin > COLD and self.has_waiting_kernels:
            self.step()

    def step(self) -> None:
        """Renders one more small view."""
        self._panorama.step()

    def stop(self) -> None:
        """Stops. The remaining kernels are compiled when they are needed."""
        self._panorama.stop()
