"""Submap models drawn by OpenGL 3.3 core: for a graphics card, where it is many times faster than the kernels.

Why the splats are projected on the CPU: a model's colours may depend on the camera position, so that all of its
coefficients would have to be sent anew for every frame; each splat would be projected four times, once per corner;
and software drivers take a third of a frame for it. The kernels do it in a few milliseconds, in a thread beside the
drawing one, and both backends agree to the last bit of what is projected.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.opengl.composite_pass import CompositePass
from nvsim.render.opengl.context import standalone_context
from nvsim.render.opengl.preparation import Preparation, Prepared
from nvsim.render.opengl.splat_pass import SplatPass
from nvsim.splats.types import SubmapModel

if TYPE_CHECKING:
    import moderngl

Color = tuple[float, float, float]
BLACK: Color = (0.0, 0.0, 0.0)


class OpenGLRenderer:
    """Standalone without `context`; with one, that of a window, which must be current at every call (in Qt:
    `moderngl.create_context()` in initializeGL, then every call between makeCurrent and doneCurrent, or in paintGL).

    on_ready   called from another thread when a frame that `draw` was asked for can be drawn: time to repaint

    All calls but `settle` come from one thread. Raises InputError where there is no OpenGL 3.3.
    """

    def __init__(self, context: moderngl.Context | None = None, on_ready: Callable[[], None] | None = None) -> None:
        self._owned, self._released = context is None, False
        self._context = standalone_context() if context is None else context
        self._name = str(self._context.info["GL_RENDERER"])
        self._splats = SplatPass(self._context)
        self._composite = CompositePass(self._context)
        self._preparation = Preparation(on_ready)
        self._wish: tuple[SubmapModel, Camera] | None = None
        self._shown: Prepared | None = None
        self._drawn: Prepared | None = None  # whose splats the first pass has drawn
        self._picture: moderngl.Framebuffer | None = None
        self._milliseconds: dict[str, float] = {}

    @property
    def name(self) -> str:
        """What the driver calls itself."""
        return self._name

    @property
    def context(self) -> moderngl.Context:
        """Its OpenGL context: framebuffers to draw into are made in it."""
        return self._context

    @property
    def milliseconds(self) -> dict[str, float]:
        """The parts of the last frame: "project", "sort", "upload"; and "frame", all of the last `render`."""
        return dict(self._milliseconds)

    def draw(
        self, model: SubmapModel, camera: Camera, framebuffer: moderngl.Framebuffer, backdrop: Color = BLACK
    ) -> Camera | None:
        """Draws into the framebuffer's viewport what is ready now, and has this view prepared if it is another one.

        Returns the camera that the picture belongs to: `camera` itself when it is exact; None when nothing is ready
        yet and the viewport was cleared. The framebuffer is in use afterwards, blending and tests are off.
        Raises what preparing an earlier view raised.
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

    def settle(self) -> None:
        """Waits until the view that was asked for last is ready; the next `draw` shows it exactly."""
        self._preparation.wait()

    def render(self, model: SubmapModel, camera: Camera, backdrop: Color = BLACK) -> NDArray[np.uint8]:
        """(H, W, 3) uint8, red, green, blue: exactly this view."""
        return self._pixels(model, camera, backdrop, blue_first=False)[..., :3]

    def render_bgrx(self, model: SubmapModel, camera: Camera, backdrop: Color = BLACK) -> NDArray[np.uint8]:
        """(H, W, 4) uint8, blue, green, red, 255, as windows want it."""
        return self._pixels(model, camera, backdrop, blue_first=True)

    def _pixels(self, model: SubmapModel, camera: Camera, backdrop: Color, blue_first: bool) -> NDArray[np.uint8]:
        begin = time.perf_counter()
        k = camera.intrinsics
        self._ask(model, camera)
        self.settle()
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
        """Makes our own context current, and afterwards the one that was; a window's is its window's business."""
        return self._context if self._owned else nullcontext()

    def _ask(self, model: SubmapModel, camera: Camera) -> None:
        if self._wish is None or self._wish[0] is not model or self._wish[1] is not camera:
            self._wish = (model, camera)
            self._preparation.request(model, camera)

    def _newest(self) -> Prepared | None:
        """What to show, its quads on the graphics card."""
        try:
            frame = self._preparation.take()
        except Exception:
            self._wish = None  # asking for the same view again tries again
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
        shown: Prepared,
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
        """Ends the thread and gives everything back; the context too, if it is ours. May be called again."""
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
