"""Who draws in the drawing process: the kernels, or OpenGL where a user wants it or it is faster. Knows no Qt."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL, Choice
from app.drawing.splat_budget import SplatBudget
from app.drawing.territory import Territory
from app.painting.tones import CHANNELS, picture
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.render.types import RenderOutput
from nvsim.splats.types import SubmapModel

NEUTRAL = (0.36, 0.37, 0.39)
"""What is behind splats that come without a background, such as those of other programs."""
HOPELESS = 2.0
"""OpenGL that takes this many times as long as the CPU is not tried on other submaps: a software driver, most likely,
and it holds 100 MB."""
TIMED_SHARE = 0.5  # of the sides of the last still image: about what a moving camera gets

Pixels = NDArray[np.uint8]
Renderer = Callable[[Camera, frozenset[str]], tuple[int, RenderOutput]]  # -> (submap that answered, view)


@dataclass(frozen=True, eq=False)
class Models:
    """What a source of trained models opens to: which model, and of which submap, answers for a camera; and which
    submap is nearest to what is seen, where there are several."""

    at: Callable[[Camera], tuple[int, SubmapModel]]
    territory: Territory | None = None


@dataclass(frozen=True)
class Remark:
    """Something for the log; a warning when it is against what a user asked for."""

    message: str
    trace: str = ""
    warning: bool = False


class Card(Protocol):
    """What is used of OpenGLRenderer."""

    @property
    def name(self) -> str: ...
    def render_bgrx(self, model: SubmapModel, camera: Camera, backdrop: tuple[float, float, float]) -> Pixels: ...
    def release(self) -> None: ...


def _opengl() -> Card:
    from nvsim.render.opengl.renderer import OpenGLRenderer

    return OpenGLRenderer()


class Painter:
    """Draws what a source opened to. `remarks` grows; whoever calls takes them out.

    make   makes the OpenGL renderer when it is first needed; raises InputError where there can be none
    """

    def __init__(self, opened: Models | Renderer, make: Callable[[], Card] = _opengl) -> None:
        self.remarks: list[Remark] = []
        self._opened, self._make = opened, make
        self._card: Card | None = None
        self._broken = self._hopeless = False
        self._choice = Choice()
        self._budget = SplatBudget()
        self._still: Camera | None = None  # of the last still colour image that either renderer may draw

    def paint(
        self, camera: Camera, channel: str, wanted: str, moving: bool, budget: int = 0
    ) -> tuple[int, Pixels, str]:
        """The submap that answered, (H, W, 4) blue, green, red, 255, and the renderer that drew it. `wanted` is one of
        PREFERENCES; no more than `budget` Gaussians are drawn unless it is 0."""
        if not isinstance(self._opened, Models):
            submap, view = self._opened(camera, CHANNELS[channel])
            return submap, picture(view, channel), CPU
        submap, model = self._opened.at(camera)
        model = self._budget.within(model, budget)
        both = channel == "rgb" and wanted == AUTOMATIC
        self._still = camera if both and not moving else None
        if channel == "rgb" and (wanted == OPENGL or (both and self._choice.faster(submap) == OPENGL)):
            pixels = self._by_opengl(model, camera, insisted=wanted == OPENGL)
            if pixels is not None:
                return submap, pixels, OPENGL
        return submap, _by_kernels(model, camera, channel, self._opened.territory), CPU

    @property
    def by_kernels(self) -> bool:
        """Whether what is drawn are models, and so by the kernels; a source may also draw by itself."""
        return isinstance(self._opened, Models)

    def look(self, camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
        """The submap that answered and what its kernels measure; without a background of its own, over nothing."""
        if not isinstance(self._opened, Models):
            return self._opened(camera, channels)
        from nvsim.render.model import render_model

        submap, model = self._opened.at(camera)
        return submap, render_model(model, camera, channels)

    def look_around(self, camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
        """As `look`, with what is measured drawn as the map builder sees it: Gaussians wide for their depth by rays."""
        if not isinstance(self._opened, Models):
            return self._opened(camera, channels)
        from nvsim.render.regions import render_regions

        submap, model = self._opened.at(camera)
        whole = np.ones((camera.intrinsics.height, camera.intrinsics.width), bool)
        return submap, render_regions(model, [camera], [whole], channels)[0]

    def compare(self) -> bool:
        """Times one frame of one renderer where the last still image stood; False when nothing is left to time."""
        if self._still is None or self._broken or self._hopeless or not isinstance(self._opened, Models):
            return False
        submap, model = self._opened.at(self._still)
        name = self._choice.to_time(submap)
        if name is None:
            return False
        k = self._still.intrinsics
        size = max(1, round(TIMED_SHARE * k.width)), max(1, round(TIMED_SHARE * k.height))
        camera = replace(self._still, intrinsics=k.scaled(*size))
        if name == OPENGL and self._ready(insisted=False) is None:
            return False
        begin = time.perf_counter()
        if name == CPU:
            _by_kernels(model, camera, "rgb")
        elif self._by_opengl(model, camera, insisted=False) is None:
            return False
        if self._choice.add(submap, name, 1e3 * (time.perf_counter() - begin)):
            self._conclude(submap)
        return True

    def _conclude(self, submap: int) -> None:
        best = self._choice.best(submap)
        driver = "" if self._card is None else f" ({self._card.name})"
        self.remarks.append(
            Remark(
                f"{self._choice.faster(submap)} draws submap {submap} while the camera moves: the CPU takes "
                f"{best[CPU]:.0f} ms, OpenGL {best[OPENGL]:.0f} ms{driver}."
            )
        )
        if best[OPENGL] > HOPELESS * best[CPU]:
            self._hopeless = True
            self.release()

    def rest(self) -> None:
        """Compares nothing until the next still image."""
        self._still = None

    def release(self) -> None:
        """Gives the graphics card's memory back."""
        if self._card is not None:
            self._card.release()
            self._card = None

    def _ready(self, insisted: bool) -> Card | None:
        if self._card is None and not self._broken:
            try:
                self._card = self._make()
            except InputError as error:
                self._broken = True
                self.remarks.append(Remark(f"The CPU draws: {error}", warning=insisted))
        return self._card

    def _by_opengl(self, model: SubmapModel, camera: Camera, insisted: bool) -> Pixels | None:
        """None where OpenGL does not work; why, becomes a remark, once."""
        card = self._ready(insisted)
        if card is None:
            return None
        try:
            return card.render_bgrx(model, camera, NEUTRAL if _is_bare(model) else (0.0, 0.0, 0.0))
        except Exception as error:  # a driver may fail in any way, and the kernels are there
            self._card, self._broken = None, True
            self.remarks.append(
                Remark(f"OpenGL failed, so the CPU draws from now on: {error}", traceback.format_exc(), True)
            )
            return None


def _is_bare(model: SubmapModel) -> bool:
    return model.background is None and model.texture is None


def _by_kernels(model: SubmapModel, camera: Camera, channel: str, territory: Territory | None = None) -> Pixels:
    from nvsim.render.model import render_model

    channels = CHANNELS[channel]
    if channel == "hole":
        return picture(render_model(replace(model, background=None, texture=None), camera, channels), channel)
    if channel == "submap" and territory is not None:
        return territory.tinted(render_model(model, camera, channels), camera)
    if channel == "rgb" and _is_bare(model):
        view = render_model(model, camera, channels | {"alpha"})
        assert view.rgb is not None and view.alpha is not None
        view.rgb += (1 - view.alpha[..., None]) * np.array(NEUTRAL, np.float32)
    else:
        view = render_model(model, camera, channels)
    return picture(view, channel)
