"""Renders submap models with OpenGL 3.3 core, for graphics cards, on which it is many times faster than the kernels.

The splats are projected on the CPU for three reasons. A model's colors can depend on the camera position, so all of
its coefficients would have to be sent for every frame. Each splat would be projected four times, once per corner.
Software drivers need a third of a frame for the projection. The kernels need a few milliseconds, in a thread beside
the drawing thread, and the projections of both backends are bit-identical.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.render.opengl.passes import CompositePass, SplatPass
from nvsim.render.opengl.preparation import Preparation, PreparedFrame
from nvsim.splats.types import SubmapModel

if TYPE_CHECKING:
    import moderngl


def standalone_context() -> moderngl.Context:
    """A new context, current in this thread. Raises InputError with the reason if none can be created."""
    import moderngl

    try:
        settings: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
        return moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # the loader raises plain Exception, the binding its own types
        raise InputError(
            f"OpenGL 3.3 cannot be used here ({error}); install a graphics driver (on Debian libegl1 and "
            "libgl1-mesa-dri), or render on the CPU."
        ) from error


Color = tuple[float, float, float]
BLACK: Color = (0.0, 0.0, 0.0)


class OpenGLRenderer:
    """A renderer with its own context if `context` is None. A given context is that of a window and must be current at
    every call. In Qt, call `moderngl.create_context()` in initializeGL; make every call between makeCurrent and
    doneCurrent or in paintGL.

    on_ready   called from another thread when a frame requested by `draw` is ready, so that you can repaint

    Make all calls except `wait_until_ready` from one thread. Raises InputError if OpenGL 3.3 is not available.
    """

    def __init__(self, context: moderngl.Context | None = None, on_ready: Callable[[], None] | None = None) -> None:
        self._owned, self._released = context is None, False
        self._context = standalone_context() if context is None else context
        self._name = str(self._context.info["GL_RENDERER"])
        self._splats = SplatPass(self._context)
        self._composite = CompositePass(self._context)
        self._preparation = Preparation(on_ready)
        self._wish: tuple[SubmapModel, Camera] | None = None
        self._shown: PreparedFrame | None = None
        self._drawn: PreparedFrame | None = None  # the frame whose splats the first pass has drawn
        self._picture: moderngl.Framebuffer | None = None
        self._milliseconds: dict[str, float] = {}

    @property
    def name(self) -> str:
        """The name that the driver reports."""
        return self._name

    @property
    def context(self) -> moderngl.Context:
        """The OpenGL context, in which you create framebuffers to draw into."""
        return self._context

    @property
    def milliseconds(self) -> dict[str, float]:
        """Milliseconds of the last frame: its parts "project", "sort", "upload"; and "frame", the last whole
        `render`."""
        return dict(self._milliseconds)

    def draw(
        self, model: SubmapModel, camera: Camera, framebuffer: moderngl.Framebuffer, backdrop: Color = BLACK
    ) -> Camera | None:
        """Draws the newest ready frame into the framebuffer's viewport, and requests this view if it is a new one.

        Returns the camera of the drawn image: `camera` itself if the image is exact. Returns None if no frame is ready
        yet and the viewport was cleared. The framebuffer is in use afterward; blending and tests are off. Raises
        errors of the preparation of an earlier view.
        """
        self._ask(model, camera)
        shown = self._newest()
        framebuffer.use()
        x, y, width, height = framebuffer.viewport
        if shown is None:
            framebuffer.clear(*backdrop, 1.0, viewport=(x, y, width, height))
            return None
        self._paint(shown, framebuffer, (x, y, width, height), backdrop, top_first=False, blue_first=False)
        return shown.camera

    def wait_until_ready(self) -> None:
        """Waits until the last requested view is ready; the next `draw` shows it exactly."""
        self._preparation.wait_until_idle()

    def render(self, model: SubmapModel, camera: Camera, backdrop: Color = BLACK) -> NDArray[np.uint8]:
        """(H, W, 3) uint8, red, green, blue: exactly this view."""
        return self._pixels(model, camera, backdrop, blue_first=False)[..., :3]

    def render_bgrx(self, model: SubmapModel, camera: Camera, backdrop: Color = BLACK) -> NDArray[np.uint8]:
        """(H, W, 4) uint8, blue, green, red, 255, the format of windows."""
        return self._pixels(model, camera, backdrop, blue_first=True)

    def _pixels(self, model: SubmapModel, camera: Camera, backdrop: Color, blue_first: bool) -> NDArray[np.uint8]:
        begin = time.perf_counter()
        k = camera.intrinsics
        self._ask(model, camera)
        self.wait_until_ready()
        with self._current():
            shown = self._newest()
            if shown is None:
                raise RuntimeError("no view was prepared")
            if self._picture is None or self._picture.size != (k.width, k.height):
                self._release_picture()
                color = self._context.renderbuffer((k.width, k.height), 4)
                self._picture = self._context.framebuffer([color])
            viewport = (0, 0, k.width, k.height)
            self._paint(shown, self._picture, viewport, backdrop, top_first=True, blue_first=blue_first)
            pixels = np.empty((k.height, k.width, 4), np.uint8)
            self._picture.read_into(pixels, components=4)
        self._milliseconds["frame"] = 1e3 * (time.perf_counter() - begin)
        return pixels

    def _current(self) -> AbstractContextManager[object]:
        """Makes an owned context current, and restores the previous one afterward. Does nothing for a window's
        context."""
        return self._context if self._owned else nullcontext()

    def _ask(self, model: SubmapModel, camera: Camera) -> None:
        if self._wish is None or self._wish[0] is not model or self._wish[1] is not camera:
            self._wish = (model, camera)
            self._preparation.request(model, camera)

    def _newest(self) -> PreparedFrame | None:
        """The frame to show, with its quads on the GPU."""
        try:
            frame = self._preparation.newest_frame()
        except Exception:
            self._wish = None  # a second request for this view tries again
            raise
        if frame is not None:
            begin = time.perf_counter()
            self._splats.upload(frame.quads)
            self._preparation.give_back(frame)
            self._shown, self._drawn = frame, None
            self._milliseconds |= {"project": frame.project_ms, "sort": frame.sort_ms}
            self._milliseconds["upload"] = 1e3 * (time.perf_counter() - begin)
        return self._shown

    def _paint(
        self,
        shown: PreparedFrame,
        framebuffer: moderngl.Framebuffer,
        viewport: tuple[int, int, int, int],
        backdrop: Color,
        top_first: bool,
        blue_first: bool,
    ) -> None:
        k = shown.camera.intrinsics
        if self._drawn is not shown:
            self._splats.draw(k.width, k.height)
            self._drawn = shown
        framebuffer.use()
        framebuffer.viewport = viewport
        self._composite.draw(
            shown.model, shown.camera, shown.coefficients, self._splats.texture, viewport,
            backdrop=backdrop, top_first=top_first, blue_first=blue_first,
        )  # fmt: skip

    def _release_picture(self) -> None:
        if self._picture is not None:
            for attachment in self._picture.color_attachments:
                attachment.release()
            self._picture.release()
            self._picture = None

    def release(self) -> None:
        """Ends the thread and releases all OpenGL objects, and the context if it is owned. Can be called again."""
        if self._released:
            return
        self._released = True
        self._preparation.close()
        with self._current():
            self._release_picture()
            self._splats.release()
            self._composite.release()
        if self._owned:
            self._context.release()

    def __enter__(self) -> OpenGLRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()
