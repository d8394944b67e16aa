"""Renders images in the rendering process: on the CPU, or with OpenGL if it is requested or faster; also in the colors
of the submaps. Does not use Qt."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.render.backends import RenderOutput
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap
from nvsim_app.drawing.marked_model import MarkedModel, Marks
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL, RendererChoice, SplatBudget
from nvsim_app.look import colors
from nvsim_app.painting.value_colors import CHANNELS, picture
from nvsim_app.processes.serving import short_reason

if TYPE_CHECKING:
    from nvsim.render.opengl.renderer import OpenGLRenderer

CELL = 0.2  # meters
REACH = 15.0  # meters around the trajectory; positions farther away belong to no submap
EYE_HEIGHT = 1.5  # assumed meters of the cameras of the trajectory above the floor
_SOLID = 0.5  # alpha from which a pixel shows a surface in front of the floor
_SHARE = 0.6  # share of the submap's color in the image


class SubmapGrid:
    """A grid in plan view that stores the submap whose core cameras are nearest to each cell."""

    def __init__(self, submaps: tuple[Submap, ...]) -> None:
        from scipy.spatial import cKDTree

        positions = np.concatenate([s.positions for s in submaps])
        owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])
        self._low = positions[:, :2].min(axis=0) - REACH
        columns, rows = np.ceil((positions[:, :2].max(axis=0) + REACH - self._low) / CELL).astype(int)
        x = self._low[0] + (np.arange(columns) + 0.5) * CELL
        y = self._low[1] + (np.arange(rows) + 0.5) * CELL
        distance, nearest = cKDTree(positions[:, :2]).query(np.stack(np.meshgrid(x, y), axis=-1))
        self._owner = np.where(distance <= REACH, owners[nearest], -1)
        self._floor = np.where(distance <= REACH, positions[nearest, 2] - EYE_HEIGHT, np.nan)
        count = int(owners.max()) + 2
        self._colors = np.array([_rgb(index) for index in range(-1, count - 1)], np.float32)

    def owner_at(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """(...) int64 index of the submap nearest to world x, y (..., 2) in meters; -1 far from the trajectory."""
        cells = np.floor((xy - self._low) / CELL)
        rows, columns = self._owner.shape
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=-1)
        result = np.full(inside.shape, -1, np.int64)
        at = cells[inside].astype(np.intp)
        result[inside] = self._owner[at[:, 1], at[:, 0]]
        return result

    def tinted(self, view: RenderOutput, camera: Camera) -> NDArray[np.uint8]:
        """(H, W, 4) uint8 image (blue, green, red, 255): the brightness of `view`, tinted with the color of the submap
        nearest to the visible surface. `view` must have rgb, alpha, and depth."""
        assert view.rgb is not None and view.alpha is not None and view.depth is not None
        k = camera.intrinsics
        right, down, forward = camera.rotation.astype(np.float32).T
        u = ((np.arange(k.width, dtype=np.float32) + 0.5 - k.cx) / k.fx)[None, :, None]
        v = ((np.arange(k.height, dtype=np.float32) + 0.5 - k.cy) / k.fy)[:, None, None]
        rays = u * right + v * down + forward  # one meter along the optical axis
        eye = camera.position.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_floor = (self._floor_under(camera.position) - eye[2]) / rays[..., 2]
            way = np.where((view.alpha >= _SOLID) | ~(to_floor > 0), view.depth, to_floor)
            owners = self.owner_at(eye[:2] + way[..., None] * rays[..., :2])
        light = np.clip(view.rgb @ np.array([0.299, 0.587, 0.114], np.float32), 0, 1)[..., None]
        tint = self._colors[owners + 1]
        result = np.empty((k.height, k.width, 4), np.uint8)
        # The lightness stays readable: the color is mixed with gray, and is brighter in bright parts of the image.
        result[..., :3] = (255 * (_SHARE * tint * (0.35 + 0.65 * light) + (1 - _SHARE) * light))[..., ::-1]
        result[..., 3] = 255
        return result

    def _floor_under(self, position: NDArray[np.floating]) -> np.float32:
        cell = np.floor((np.asarray(position)[:2] - self._low) / CELL).astype(int)
        rows, columns = self._floor.shape
        column, row = np.clip(cell, 0, (columns - 1, rows - 1))
        floor = self._floor[row, column]
        return np.float32(np.nanmedian(self._floor) if np.isnan(floor) else floor)


def _rgb(index: int) -> tuple[float, float, float]:
    text = colors.submap_color(index)
    red, green, blue = (int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


NEUTRAL = (0.36, 0.37, 0.39)
"""Background color of models without a background, such as splat files of other programs."""
HOPELESS = 2.0
"""If OpenGL takes more than this many times as long as the CPU, other submaps do not try it. The driver is then most
likely a software driver, which uses 100 MB."""
TIMED_SHARE = 0.5  # side length of timed images relative to the last still image, about the size while moving

Pixels = NDArray[np.uint8]
Renderer = Callable[[Camera, frozenset[str]], tuple[int, RenderOutput]]  # -> (index of the submap, view)


@dataclass(frozen=True, eq=False)
class Models:
    """The opened models of a source.

    at          maps a camera to the index and the model of the submap that renders it
    territory   the nearest submap of each position, None if there is only one model
    """

    at: Callable[[Camera], tuple[int, SubmapModel]]
    territory: SubmapGrid | None = None


@dataclass(frozen=True)
class LogRemark:
    """A message for the log. It is a warning if a request of the user could not be met."""

    message: str
    trace: str = ""
    warning: bool = False


def _opengl() -> OpenGLRenderer:
    from nvsim.render.opengl.renderer import OpenGLRenderer

    return OpenGLRenderer()


class Painter:
    """Renders an opened source. The caller reads and removes the messages in `remarks`.

    make   creates the OpenGL renderer when it is first needed; raises InputError if OpenGL is not available
    """

    def __init__(self, opened: Models | Renderer, make: Callable[[], OpenGLRenderer] = _opengl) -> None:
        self.remarks: list[LogRemark] = []
        self._opened, self._make = opened, make
        self._card: OpenGLRenderer | None = None
        self._broken = self._hopeless = False
        self._choice = RendererChoice()
        self._budget = SplatBudget()
        self._marked = MarkedModel()
        self._still: Camera | None = None  # of the last still color image with automatic choice of the renderer

    def paint(
        self,
        camera: Camera,
        channel: str,
        wanted: str,
        moving: bool,
        budget: int = 0,
        marks: Marks | None = None,
    ) -> tuple[int, Pixels, str]:
        """Returns the submap index, the (H, W, 4) uint8 image (blue, green, red, 255), and the renderer that was used.
        `wanted` is one of PREFERENCES. At most `budget` Gaussians are rendered; 0 means all. `marks` colors or hides
        Gaussians of a source with one model."""
        if not isinstance(self._opened, Models):
            submap, view = self._opened(camera, CHANNELS[channel])
            return submap, picture(view, channel), CPU
        submap, model = self._opened.at(camera)
        if marks is not None:
            model = self._marked.of(model, marks)
        model = self._budget.limit_model(model, budget)
        both = channel == "rgb" and wanted == AUTOMATIC
        self._still = camera if both and not moving else None
        if channel == "rgb" and (wanted == OPENGL or (both and self._choice.faster(submap) == OPENGL)):
            pixels = self._by_opengl(model, camera, insisted=wanted == OPENGL)
            if pixels is not None:
                return submap, pixels, OPENGL
        return submap, _by_kernels(model, camera, channel, self._opened.territory), CPU

    @property
    def by_kernels(self) -> bool:
        """Whether the source consists of models, which the kernels render. Other sources render images themselves."""
        return isinstance(self._opened, Models)

    def render_view(self, camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
        """The submap index and the view that the CPU kernels render. Models without a background are rendered over
        black."""
        if not isinstance(self._opened, Models):
            return self._opened(camera, channels)
        from nvsim.render.model import render_model

        submap, model = self._opened.at(camera)
        return submap, render_model(model, camera, channels)

    def look_around(self, camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
        """Like `render_view`, but rendered like the map builder's views (`render_regions`): Gaussians that are large
        relative to their depth are evaluated per ray."""
        if not isinstance(self._opened, Models):
            return self._opened(camera, channels)
        from nvsim.render.scene import render_regions

        submap, model = self._opened.at(camera)
        whole = np.ones((camera.intrinsics.height, camera.intrinsics.width), bool)
        return submap, render_regions(model, [camera], [whole], channels)[0]

    def compare(self) -> bool:
        """Times one frame of one renderer at the camera of the last still image. Returns False if nothing is left to
        time."""
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
            self._report_choice(submap)
        return True

    def _report_choice(self, submap: int) -> None:
        best = self._choice.best(submap)
        driver = "" if self._card is None else f" ({self._card.name})"
        self.remarks.append(
            LogRemark(
                f"{self._choice.faster(submap)} renders submap {submap} while the camera moves: the CPU takes "
                f"{best[CPU]:.0f} ms, OpenGL {best[OPENGL]:.0f} ms{driver}."
            )
        )
        if best[OPENGL] > HOPELESS * best[CPU]:
            self._hopeless = True
            self.release()

    def pause_comparison(self) -> None:
        """Stops the comparison of renderers until the next still image."""
        self._still = None

    def release(self) -> None:
        """Releases the memory of the graphics card."""
        if self._card is not None:
            self._card.release()
            self._card = None

    def _ready(self, insisted: bool) -> OpenGLRenderer | None:
        if self._card is None and not self._broken:
            try:
                self._card = self._make()
            except InputError as error:
                self._broken = True
                self.remarks.append(LogRemark(f"The CPU renders: {error}", warning=insisted))
        return self._card

    def _by_opengl(self, model: SubmapModel, camera: Camera, insisted: bool) -> Pixels | None:
        """The image, or None if OpenGL does not work. The reason is added to the remarks once."""
        card = self._ready(insisted)
        if card is None:
            return None
        try:
            return card.render_bgrx(model, camera, NEUTRAL if _is_bare(model) else (0.0, 0.0, 0.0))
        except Exception as error:  # a driver may fail in any way; the CPU is the fallback
            self._card, self._broken = None, True
            self.remarks.append(
                LogRemark(
                    f"OpenGL failed, so the CPU renders from now on: {short_reason(error)}",
                    traceback.format_exc(),
                    True,
                )
            )
            return None


def _is_bare(model: SubmapModel) -> bool:
    return model.background is None and model.texture is None


def _by_kernels(model: SubmapModel, camera: Camera, channel: str, territory: SubmapGrid | None = None) -> Pixels:
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
