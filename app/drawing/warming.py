"""Compiles in the drawing process what a user would otherwise wait for when it is first asked for. Once on a machine
this takes half a minute; later it is read from the cache in a moment. Knows no Qt."""

from __future__ import annotations

import time

import numpy as np

from app.drawing.painter import Painter
from app.drawing.panorama_child import PanoramaDrawing, PanoramaRequest
from app.drawing.renderer_choice import CPU
from nvsim.geometry.camera import Camera, Intrinsics

COLD = 3.0  # seconds; a first image that took longer was compiled
_EYE = np.eye(4)
_SIDE = 32  # pixels


class Warming:
    """First what every image needs, then, in pauses, what panoramas need besides."""

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._panorama = PanoramaDrawing(painter.look_around)

    @property
    def waits(self) -> bool:
        """Whether something is left for the pauses."""
        return self._panorama.waits

    def begin(self) -> None:
        """Draws a small image. Where that had to be compiled the rest follows at once: a user who waits already would
        rather not wait again."""
        begin = time.perf_counter()
        self._painter.paint(Camera(Intrinsics.from_fov(_SIDE, _SIDE, 1.0), _EYE), "rgb", CPU, moving=True)
        if not self._painter.by_kernels:
            return
        self._panorama.begin(PanoramaRequest("warming", (0.0, 0.0, 0.0), (2 * _SIDE,)))
        while time.perf_counter() - begin > COLD and self.waits:
            self.step()

    def step(self) -> None:
        """One small view more."""
        self._panorama.step()

    def stop(self) -> None:
        """Leaves the rest to whoever needs it."""
        self._panorama.stop()
