"""Compiles the render kernels of the window ahead of time: at the end of an installation, and while the window shows no
project. Does not use Qt.

python -m nvsim_app.drawing.compilation   compiles once per machine; prints one sentence if something is compiled
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import partial

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim_app.processes.serving import Requests

SAID = "Compiling the renderer of the window, once on this machine; this takes about half a minute."
_SOURCES = ("geometry", "splats", "render")
_SIDE = 48  # pixels


def compile_once(tell: Callable[[str], object]) -> None:
    """Compiles the kernels, unless they were compiled on this machine from the same sources. Calls `tell` with a
    sentence if that is necessary. Raises InputError or OSError if the cache cannot be written."""
    from numba.core import event

    from nvsim.render.kernel_cache import process_lock, stamp

    class FirstCompilation(event.Listener):
        """Tells once that kernels are compiled. Numba reports a kernel only if it is not in the cache."""

        reported = False

        def on_start(self, event: object) -> None:
            if not self.reported:
                self.reported = True
                tell(SAID)

        def on_end(self, event: object) -> None:
            pass

    done = stamp("window", _SOURCES)
    if done.exists():
        return
    with process_lock(done.with_suffix(".lock")):
        if not done.exists():  # another process may have compiled meanwhile
            with event.install_listener("numba:compile", FirstCompilation()):
                compile_renderers()
            atomic.write_text(done, "")


def compile_renderers() -> None:
    """Renders small images with the functions that the rendering process uses, which compiles their kernels.

    It renders every channel and a panorama of a model with all optional parts, and runs OpenGL's work on the CPU."""
    import numpy as np

    from nvsim.benchmarks.random_room import random_room
    from nvsim.geometry.camera import Camera, Intrinsics
    from nvsim.render.opengl.benchmark import with_floor_and_background
    from nvsim.render.opengl.preparation import Sorter
    from nvsim.render.opengl.quads import QUAD_WIDTH
    from nvsim_app.drawing.painter import Models, Painter
    from nvsim_app.drawing.renderer_choice import CPU
    from nvsim_app.drawing.warming import Warming
    from nvsim_app.painting.value_colors import CHANNELS

    model = with_floor_and_background(random_room(500))
    painter = Painter(Models(lambda camera: (0, model)))
    camera = Camera(Intrinsics.from_fov(_SIDE, _SIDE, 1.0), np.eye(4))
    for channel in CHANNELS:
        painter.paint(camera, channel, CPU, moving=True)
    warming = Warming(painter)
    warming.begin()
    while warming.has_waiting_kernels:
        warming.step()
    Sorter().prepare(model, camera, np.empty((0, QUAD_WIDTH), np.float32))


def serve(requests: Requests, source: object) -> None:
    """The work of a side process: compiles the kernels, and tells if that is necessary."""
    compile_once(requests.send_notice)


def main() -> int:
    """Returns exit code 0, or prints one sentence and returns 1."""
    if hasattr(os, "nice"):
        os.nice(5)  # the window has priority
    try:
        compile_once(partial(print, flush=True))
    except (InputError, OSError, LookupError) as error:
        print(f"The renderer of the window was not compiled ahead: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
