"""The rendering process: answers requests with images that are ready to paint. Does not use Qt.

A separate process is necessary: importing and compiling the kernels holds Python's global lock for up to 150 ms at a
time. The window also survives a crash of a kernel.
"""

from __future__ import annotations

import contextlib
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.project.layout import Layout
from nvsim.splats.types import SubmapModel
from nvsim_app.drawing.marked_model import Marks
from nvsim_app.drawing.painter import LogRemark, Models, Painter, Renderer, SubmapGrid
from nvsim_app.drawing.panorama_child import PanoramaDrawing, PanoramaRequest
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU
from nvsim_app.drawing.warming import Warming
from nvsim_app.painting.value_colors import CHANNELS, MEASURED, measured, picture
from nvsim_app.processes.serving import Requests, short_reason

LOOK_AGAIN = 1.0  # seconds between two checks for a new version of a model in training
WHOLE = -1  # used as submap index of the whole building without ceilings


class RenderSource(Protocol):
    """A picklable source of images that the rendering process opens."""

    def open(self) -> Models | Renderer:
        """Raises InputError if there is nothing to render."""
        ...


@dataclass(frozen=True)
class ProjectSource:
    """The trained models of a project. `memory_budget` limits the memory of loaded models in bytes (see SceneModel)."""

    path: Path
    memory_budget: int | None = None

    def open(self) -> Models:
        models = ProjectModels(self)
        return Models(models.model_for, models.territory)


@dataclass(frozen=True)
class WholeSplatSource:
    """All Gaussians of a project from splat files as one model, also the removed ones."""

    path: Path

    def open(self) -> Models:
        from nvsim.project.cleaning import read_whole_splat
        from nvsim.project.project import Project

        with Project.open(self.path) as project:
            model = read_whole_splat(project).model
        return Models(lambda camera: (WHOLE, model))


class ProjectModels:
    """The models of a project. Models in training are reloaded after each save. `territory` gives the nearest submap of
    a position."""

    def __init__(self, source: ProjectSource) -> None:
        """Raises InputError if the project has no trained model."""
        self._source = source
        self._looked = time.monotonic()
        self._stamp = self._live_stamp()
        self._load()

    def model_for(self, camera: Camera) -> tuple[int, SubmapModel]:
        """The index and the model of the submap that renders this camera. A camera above the rooms gets WHOLE and the
        model without ceilings."""
        if self._stamp and time.monotonic() - self._looked > LOOK_AGAIN:
            self._looked = time.monotonic()
            stamp = self._live_stamp()
            if stamp and stamp != self._stamp:
                self._stamp = stamp
                self._load()
        if self._cutaway.is_outside(camera.position):
            return WHOLE, self._cutaway.model
        return self._scene.model_at(camera.position)

    def _live_stamp(self) -> tuple[tuple[str, int], ...]:
        found = sorted(Layout(self._source.path).checkpoints.glob("live_*/model.json"))
        with contextlib.suppress(OSError):  # a file is being replaced; the next check will find it
            return tuple((str(p), p.stat().st_mtime_ns) for p in found)
        return ()

    def _load(self) -> None:
        from nvsim.project.project import Project
        from nvsim_app.drawing.cutaway import Cutaway

        with Project.open(self._source.path) as project:
            scene = project.scene(self._source.memory_budget, live=True)
            submaps, support = project.submaps_as_cut("train"), project.support()
        if scene is None:
            raise InputError(f"{self._source.path} has no trained model.")
        self._scene = scene
        self._cutaway = Cutaway(scene, submaps, None if support is None else support.is_supported)
        self.territory = SubmapGrid(submaps)


@dataclass(frozen=True, eq=False)
class Request:
    """A request for an image.

    number     increases with each request
    channel    one of tones.CHANNELS
    moving     whether the camera still moves
    renderer   one of renderer_choice.PREFERENCES
    view       name of the requester; a newer request replaces only its own waiting request
    budget     maximum number of rendered Gaussians, 0 for all
    values     whether to return the numbers that the colors of a measured channel represent
    marks      colored or hidden Gaussians of a WholeSplatSource
    """

    number: int
    camera: Camera
    channel: str
    moving: bool
    renderer: str = AUTOMATIC
    view: str = "scene"
    budget: int = 0
    values: bool = False
    marks: Marks | None = None


@dataclass(frozen=True, eq=False)
class Picture:
    """A rendered image.

    pixels         (H, W, 4) uint8 in the order blue, green, red, 255, the memory layout of QImage's Format_RGB32
    submap         index of the submap that was rendered
    milliseconds   render time
    renderer       renderer_choice.CPU or OPENGL
    values         float32 result of tones.measured, if it was requested and the channel is measured
    """

    request: Request
    pixels: NDArray[np.uint8]
    submap: int
    milliseconds: float
    renderer: str = CPU
    values: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class RenderError:
    """An error: a sentence for the user and the traceback for the log. If it is fatal, the process ends."""

    message: str
    trace: str = ""
    fatal: bool = False


def serve(requests: Requests, source: RenderSource) -> None:
    """Opens the source, then answers requests until the window closes."""
    painter = Painter(source.open())
    warming = Warming(painter)
    warming.begin()
    panoramas = PanoramaDrawing(painter.look_around)
    panorama = 0  # number of its request
    while True:
        _use_the_pause(painter, panoramas, panorama, warming, requests)
        number, request = requests.wait_for_request()
        if isinstance(request, PanoramaRequest):
            panoramas.begin(request)
            panorama = number
            continue
        requests.answer(number, _answer(painter, request))
        _send_remarks(painter, requests)


def _use_the_pause(
    painter: Painter, panoramas: PanoramaDrawing, panorama: int, warming: Warming, requests: Requests
) -> None:
    """Works in small steps until the next request arrives: renders the requested panorama, compiles the kernels of
    panoramas, then compares the renderers."""
    try:
        while not requests.waiting and panoramas.has_waiting_views:
            finished = panoramas.step()
            if finished is not None:
                requests.answer(panorama, finished, more=not finished.final)
    except Exception as error:
        panoramas.stop()
        requests.answer(
            panorama, RenderError(f"The panorama could not be rendered: {short_reason(error)}", traceback.format_exc())
        )
    try:
        while not requests.waiting and warming.has_waiting_kernels:
            warming.step()
    except Exception as error:  # a request for a panorama will report the error again
        warming.stop()
        painter.remarks.append(
            LogRemark(f"Panoramas could not be prepared: {short_reason(error)}", traceback.format_exc(), True)
        )
    try:
        while not requests.waiting and painter.compare():
            pass
    except Exception as error:  # images do not depend on the comparison
        painter.remarks.append(
            LogRemark(f"The renderers could not be compared: {short_reason(error)}", traceback.format_exc(), True)
        )
        painter.pause_comparison()
    _send_remarks(painter, requests)


def _send_remarks(painter: Painter, requests: Requests) -> None:
    while painter.remarks:
        requests.send_notice(painter.remarks.pop(0))


def _answer(painter: Painter, request: Request) -> Picture | RenderError:
    begin = time.perf_counter()
    try:
        if request.values and request.channel in MEASURED:
            submap, view = painter.render_view(request.camera, CHANNELS[request.channel])
            pixels, values = picture(view, request.channel), measured(view, request.channel)
            return Picture(request, pixels, submap, 1e3 * (time.perf_counter() - begin), CPU, values)
        submap, pixels, renderer = painter.paint(
            request.camera, request.channel, request.renderer, request.moving, request.budget, request.marks
        )
    except Exception as error:
        return RenderError(f"A view could not be rendered: {short_reason(error)}", traceback.format_exc())
    return Picture(request, pixels, submap, 1e3 * (time.perf_counter() - begin), renderer)
