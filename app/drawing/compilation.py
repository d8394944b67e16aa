"""Compiles what the window draws with before somebody waits for it: at the end of an installation, and beside a window
that has nothing to draw yet. Knows no Qt.

python -m app.drawing.compilation   does it, once on a machine; prints one sentence when there is something to do
"""

from __future__ import annotations

import os
import sys

import numpy as np

from app.drawing.painter import Models, Painter
from app.drawing.renderer_choice import CPU
from app.drawing.warming import Warming
from app.painting.tones import CHANNELS
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.geometry.camera import Camera, Intrinsics

SAID = "Compiling what the window draws with, once on this machine; half a minute."
_SOURCES = ("geometry", "splats", "render")
_SIDE = 48  # pixels


def compile_once() -> None:
    """Returns at once when this was done before on this machine with these sources. Raises InputError or OSError where
    the cache cannot be written."""
    from nvsim.render.kernel_cache import alone, stamp

    done = stamp("window", _SOURCES)
    if done.exists():
        return
    with alone(done.with_suffix(".lock")):
        if not done.exists():  # another process did it meanwhile
            print(SAID, flush=True)
            draw_in_small()
            atomic.write_text(done, "")


def draw_in_small() -> None:
    """A small image of every channel and a panorama, of a model that has all that a model may have, and what OpenGL
    needs of the CPU: it calls what the drawing process calls."""
    from nvsim.benchmarks.random_room import random_room
    from nvsim.render.opengl.benchmark import furnished
    from nvsim.render.opengl.preparation import Sorter
    from nvsim.render.opengl.quads import QUAD_WIDTH

    model = furnished(random_room(500))
    painter = Painter(Models(lambda camera: (0, model)))
    camera = Camera(Intrinsics.from_fov(_SIDE, _SIDE, 1.0), np.eye(4))
    for channel in CHANNELS:
        painter.paint(camera, channel, CPU, moving=True)
    warming = Warming(painter)
    warming.begin()
    while warming.waits:
        warming.step()
    Sorter().prepare(model, camera, np.empty((0, QUAD_WIDTH), np.float32))


def main() -> int:
    """Exit code 0, or 1 after a sentence."""
    if hasattr(os, "nice"):
        os.nice(5)  # the window comes first
    try:
        compile_once()
    except (InputError, OSError, LookupError) as error:
        print(f"What the window draws with was not compiled ahead: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
