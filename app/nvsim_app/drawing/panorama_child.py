"""Panoramas in the rendering process: rendered view by view between other requests, coarse first. Does not use Qt."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import RenderOutput
from nvsim_app.painting.value_colors import picture

PANORAMA_CHANNELS = ("rgb", "alpha", "normal")
WIDTHS = (384, 1024)  # width of the coarse and of the sharp panorama, pixels
Look = Callable[[Camera, frozenset[str]], tuple[int, RenderOutput]]


@dataclass(frozen=True)
class PanoramaRequest:
    """A request for a panorama.

    key        the caller's name of the request
    position   (x, y, z) of the camera, meters, world
    widths     widths in pixels, in the order of rendering
    """

    key: Hashable
    position: tuple[float, float, float]
    widths: tuple[int, ...] = WIDTHS


@dataclass(frozen=True, eq=False)
class Panorama:
    """A rendered panorama.

    key            the key of the request
    pixels         for each of PANORAMA_CHANNELS (W / 2, W, 4) uint8: blue, green, red, 255; north is in the center,
                   east to its right
    submap         index of the submap that was rendered
    milliseconds   render time without pauses
    final          whether this is the last and finest panorama of the request
    """

    key: Hashable
    width: int
    pixels: dict[str, NDArray[np.uint8]]
    submap: int
    milliseconds: float
    final: bool


class PanoramaDrawing:
    """Renders the newest requested panorama step by step. `look` renders one view."""

    def __init__(self, look: Look) -> None:
        self._look = look
        self._steps: Iterator[Panorama | None] | None = None

    @property
    def has_waiting_views(self) -> bool:
        """Whether views of a panorama remain to be rendered."""
        return self._steps is not None

    def begin(self, request: PanoramaRequest) -> None:
        self._steps = self._draw(request)

    def stop(self) -> None:
        self._steps = None

    def step(self) -> Panorama | None:
        """Renders one view. Returns the panorama if it was the last view."""
        if self._steps is None:
            return None
        try:
            return next(self._steps)
        except StopIteration:
            self._steps = None
            return None

    def _draw(self, request: PanoramaRequest) -> Iterator[Panorama | None]:
        from nvsim.render.equirectangular import axes_ahead, half_angles, resample, views_around
        from nvsim.render.workspace import LOCK

        eye = np.array(request.position, np.float64)
        channels = frozenset(PANORAMA_CHANNELS)
        for width in request.widths:
            cameras = views_around(eye, width, 0.0)
            side = cameras[0].intrinsics.width
            colors, shapes = (np.zeros((len(cameras), side, side, 4), np.float32) for _ in range(2))
            spent, submap = 0.0, -1
            for i, camera in enumerate(cameras):
                begin = time.perf_counter()
                submap, view = self._look(camera, channels)
                assert view.rgb is not None and view.alpha is not None and view.normal is not None
                colors[i, ..., :3], colors[i, ..., 3], shapes[i, ..., :3] = view.rgb, view.alpha, view.normal
                spent += time.perf_counter() - begin
                yield None
            begin = time.perf_counter()
            height = width // 2
            wanted = np.ones((height, width), bool)
            images = [np.empty((height, width, 4), np.float32) for _ in range(2)]
            focal = np.float32(cameras[0].intrinsics.fx)
            with LOCK:
                resample(colors, shapes, axes_ahead(), focal, *half_angles(width, height), wanted, *images)
            whole = RenderOutput(
                np.ascontiguousarray(images[0][..., :3]),
                np.ascontiguousarray(images[0][..., 3]),
                None,
                np.ascontiguousarray(images[1][..., :3]),
            )
            pixels = {name: picture(whole, name) for name in PANORAMA_CHANNELS}
            spent += time.perf_counter() - begin
            yield Panorama(request.key, width, pixels, submap, 1e3 * spent, width == request.widths[-1])
