"""The process that draws: asked for views through a pipe, answers with pictures ready to be painted. Knows no Qt.

A process of its own, because importing and compiling the kernels holds Python's global lock for up to 150 ms at a
time, and because a window must survive whatever happens in a kernel.
"""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.tones import CHANNELS, picture
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.render.types import RenderOutput

WHOLE = -1  # in place of a submap's index: the whole building without its ceilings
Renderer = Callable[[Camera, frozenset[str]], tuple[int, RenderOutput]]  # -> (submap that answered, view)


class RenderSource(Protocol):
    """Something picklable that can be opened in another process."""

    def open(self) -> Renderer:
        """Raises InputError when there is nothing to draw."""
        ...


@dataclass(frozen=True)
class ProjectSource:
    """The trained models of a project, with `memory_budget` bytes for those in memory, as SceneModel takes it."""

    path: Path
    memory_budget: int | None = None

    def open(self) -> Renderer:
        from app.cutaway import Cutaway
        from nvsim.project.project import Project
        from nvsim.render.model import render_model
        from nvsim.render.scene import render_scene

        with Project.open(self.path) as project:
            scene = project.scene(self.memory_budget)
            submaps, support = project.submaps(), project.support()
        if scene is None:
            raise InputError(f"{self.path} has no trained model.")
        cutaway = Cutaway(scene, submaps, None if support is None else support.at)

        def render(camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
            if cutaway.is_outside(camera.position):
                return WHOLE, render_model(cutaway.model, camera, channels)
            return render_scene(scene, camera, channels)

        return render


@dataclass(frozen=True, eq=False)
class Request:
    """number rises; channel is one of tones.CHANNELS; moving says that the eye has not come to rest."""

    number: int
    camera: Camera
    channel: str
    moving: bool


@dataclass(frozen=True, eq=False)
class Picture:
    """pixels (H, W, 4) uint8 in the order blue, green, red, 255, as QImage's Format_RGB32 has it in memory;
    milliseconds it took to draw."""

    request: Request
    pixels: NDArray[np.uint8]
    submap: int
    milliseconds: float


@dataclass(frozen=True)
class Opened:
    """The source is loaded and the kernels are compiled; seconds it took."""

    seconds: float


@dataclass(frozen=True)
class Trouble:
    """A sentence for the person, and the trace for the log."""

    message: str
    trace: str = ""
    fatal: bool = False


def serve(connection: Connection, source: RenderSource) -> None:
    """Opens the source, then answers requests until the other end closes the pipe."""
    if hasattr(os, "nice"):
        os.nice(5)  # the window comes first
    begin = time.perf_counter()
    try:
        render = source.open()
        _warm_up(render)
    except InputError as error:
        connection.send(Trouble(str(error), fatal=True))
        return
    except Exception as error:
        connection.send(Trouble(f"The reconstruction cannot be drawn: {error}", traceback.format_exc(), fatal=True))
        return
    try:
        connection.send(Opened(time.perf_counter() - begin))
        while True:
            request: Request = connection.recv()
            connection.send(_answer(render, request))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # the window is gone


def _answer(render: Renderer, request: Request) -> Picture | Trouble:
    begin = time.perf_counter()
    try:
        submap, view = render(request.camera, CHANNELS[request.channel])
        pixels = picture(view, request.channel)
    except Exception as error:
        return Trouble(f"A view could not be drawn: {error}", traceback.format_exc())
    return Picture(request, pixels, submap, 1e3 * (time.perf_counter() - begin))


def _warm_up(render: Renderer) -> None:
    """Compiles what the first frame would otherwise wait for."""
    from nvsim.geometry.camera import Intrinsics

    tiny = Camera(Intrinsics.from_fov(32, 32, 1.0), np.eye(4))
    for channels in {CHANNELS["rgb"]}:
        render(tiny, channels)
