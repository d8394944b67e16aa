"""After an installation nothing that the window draws with is left to compile."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from nvsim import kernel_folder
from nvsim.render import kernel_cache
from nvsim_app.drawing import compilation

AFTERWARDS = """
import sys
from pathlib import Path
import numpy as np
from numba.core.dispatcher import Dispatcher
from nvsim_app.drawing.compilation import compile_renderers
from nvsim_app.drawing.painter import Models, Painter
from nvsim_app.drawing.warming import Warming
from nvsim_app.painting.value_colors import CHANNELS
from nvsim.benchmarks.random_room import random_room
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.opengl.benchmark import with_floor_and_background
from nvsim.render.opengl.preparation import Sorter
from nvsim.splats.types import Gaussians, SubmapModel

def compiled():
    found = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("nvsim.")]:
        for kernel in vars(module).values():
            if isinstance(kernel, Dispatcher):
                found[f"{kernel.__module__}.{kernel.__qualname__}"] = set(kernel.signatures)
    return found

compile_renderers()
ahead = compiled()
assert len(ahead) > 5
flat = Gaussians(*(np.ascontiguousarray(a) for a in vars(random_room(300)).values()))
flat.sh = np.ascontiguousarray(flat.sh[:, :1])
rich = with_floor_and_background(random_room(900), antialiased=False)
for model in (rich, SubmapModel(flat, None, None, FloorSurface.flat(0.0))):
    painter = Painter(Models(lambda camera: (0, model)))
    camera = Camera(Intrinsics.from_fov(61, 47, 1.2), np.eye(4))
    for channel in CHANNELS:
        for moving in (True, False):
            painter.paint(camera, channel, "cpu", moving)
    warming = Warming(painter)
    warming.begin()
    while warming.has_waiting_kernels:
        warming.step()
    Sorter().prepare(model, camera, np.empty((0, 10), np.float32))
more = {name: found - ahead.get(name, set()) for name, found in compiled().items() if found - ahead.get(name, set())}
assert not more, more
"""


def test_nothing_is_left_to_compile_for_the_first_window() -> None:
    child = subprocess.run([sys.executable, "-c", AFTERWARDS], capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr


def test_it_is_done_and_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    drawn: list[int] = []

    def compile_two() -> None:
        drawn.append(1)
        for add in (lambda x: x + 1, lambda x: x + 2):
            numba.njit(add)(1)

    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module: tmp_path)
    monkeypatch.setattr(compilation, "compile_renderers", compile_two)
    compilation.compile_once(print)
    compilation.compile_once(print)
    assert len(drawn) == 1 and capsys.readouterr().out.count(compilation.SAID) == 1


def test_nothing_is_said_if_the_kernels_are_already_in_the_cache(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module: tmp_path)
    monkeypatch.setattr(compilation, "compile_renderers", lambda: None)
    compilation.compile_once(print)
    assert list(tmp_path.glob("*.compiled")) and capsys.readouterr().out == ""


def test_kernels_compiled_since_a_time_are_found(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv(kernel_folder.VARIABLE, str(tmp_path))
    begin = time.time() - 10
    assert not kernel_folder.compiled_since(begin)
    (tmp_path / "render").mkdir()
    (tmp_path / "render" / "kernel.1.nbc").write_bytes(b"")
    assert kernel_folder.compiled_since(begin) and not kernel_folder.compiled_since(begin + 100)


def test_one_that_was_broken_off_is_not_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks_off() -> None:
        raise OSError("no room on the disk")

    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module: tmp_path)
    monkeypatch.setattr(compilation, "compile_renderers", breaks_off)
    with pytest.raises(OSError, match="no room"):
        compilation.compile_once(print)
    assert not list(tmp_path.glob("*.compiled"))
