"""Prepares frames in a separate thread: projects the splats, sorts them by depth, and converts them to quads.

The drawing thread never waits for the sort. It draws the last frame that is ready while the next one is prepared. Each
frame is prepared for one camera and drawn with it, so that the whole image can be late, but never the order alone.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Float32
from nvsim.render.opengl.quads import QUAD_WIDTH, nearest_first, write_quads
from nvsim.render.workspace import LOCK, RenderBuffers, as_kernel_array
from nvsim.splats.types import Gaussians, SubmapModel


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame ready to be drawn.

    quads         (M, QUAD_WIDTH) float32, nearest first
    coefficients  (25, 3) float32 of the background seen from the camera, None without one
    project_ms    milliseconds of the projection
    sort_ms       milliseconds of the sort and of writing the quads
    """

    model: SubmapModel
    camera: Camera
    quads: Float32
    coefficients: Float32 | None
    project_ms: float
    sort_ms: float


class Sorter:
    """The buffers for the preparation of frames, kept between frames."""

    def __init__(self) -> None:
        self._workspace = RenderBuffers()
        self._keys = np.empty((2, 0), np.uint32)
        self._order = np.empty((2, 0), np.int32)

    def prepare(self, model: SubmapModel, camera: Camera, memory: Float32) -> PreparedFrame:
        """Prepares a frame. Its quads are in `memory` (N, QUAD_WIDTH), or in new memory if that is too small."""
        begin = time.perf_counter()
        g = model.gaussians_at(camera.position)
        arrays = Gaussians(*map(as_kernel_array, g.arrays))
        with LOCK:
            self._workspace.project(arrays, camera, model.antialiased)
            projected = time.perf_counter()
            splats, visible = self._workspace.splats
            if self._keys.shape[1] < len(splats):
                room = len(splats) + len(splats) // 4 + 64
                self._keys, self._order = np.empty((2, room), np.uint32), np.empty((2, room), np.int32)
            keys, order = self._keys, self._order
            count = nearest_first(splats, visible, keys[0], order[0], keys[1], order[1])
            if len(memory) < count:
                memory = np.empty((count + count // 4 + 64, QUAD_WIDTH), np.float32)
            write_quads(splats, order[0], count, self._workspace.threads, memory)
        coefficients = None if model.background is None else model.background.coefficients(camera.position)
        sorted_ = time.perf_counter()
        return PreparedFrame(
            model, camera, memory[:count], coefficients, 1e3 * (projected - begin), 1e3 * (sorted_ - projected)
        )


class Preparation:
    """Prepares the newest requested view in its thread; older requests are dropped.

    on_ready   called in that thread when a frame is ready
    """

    def __init__(self, on_ready: Callable[[], None] | None = None) -> None:
        self._on_ready = on_ready
        self._changed = threading.Condition()
        self._wanted: tuple[SubmapModel, Camera] | None = None
        self._ready: PreparedFrame | None = None
        self._failure: Exception | None = None
        self._spare: list[Float32] = []
        self._busy = self._closed = False
        self._thread: threading.Thread | None = None

    def request(self, model: SubmapModel, camera: Camera) -> None:
        """Requests this view next. Raises RuntimeError after `close`."""
        with self._changed:
            if self._closed:
                raise RuntimeError("this renderer was released")
            self._wanted = (model, camera)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="splat order", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def newest_frame(self) -> PreparedFrame | None:
        """The newest frame, None if none became ready since the last call. Raises errors of the preparation."""
        with self._changed:
            if self._failure is not None:
                failure, self._failure = self._failure, None
                raise failure
            frame, self._ready = self._ready, None
            return frame

    def give_back(self, frame: PreparedFrame) -> None:
        """Allows the memory of a frame to be overwritten."""
        with self._changed:
            self._reuse(frame)

    def wait_until_idle(self) -> None:
        """Waits until no view is requested or in preparation."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or (self._wanted is None and not self._busy))

    def close(self) -> None:
        """Ends the thread. Can be called again."""
        with self._changed:
            self._closed, self._wanted = True, None
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _reuse(self, frame: PreparedFrame) -> None:
        if isinstance(frame.quads.base, np.ndarray) and len(self._spare) < 2:
            self._spare.append(frame.quads.base)

    def _run(self) -> None:
        sorter = Sorter()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._wanted is not None)
                if self._closed or self._wanted is None:
                    return
                (model, camera), self._wanted, self._busy = self._wanted, None, True
                memory = self._spare.pop() if self._spare else np.empty((0, QUAD_WIDTH), np.float32)
            frame, failure = None, None
            try:
                frame = sorter.prepare(model, camera, memory)
            except Exception as error:
                failure = error  # raised again by `newest_frame`
            with self._changed:
                if frame is not None:
                    if self._ready is not None:
                        self._reuse(self._ready)
                    self._ready = frame
                self._failure, self._busy = failure, False
                self._changed.notify_all()
            if self._on_ready is not None:
                self._on_ready()
