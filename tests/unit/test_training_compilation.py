"""Kernels are compiled ahead once, and a machine where that fails trains all the same."""

from __future__ import annotations

import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import psutil
import pytest

from nvsim.errors import InputError
from nvsim.events import Event, Log, Warning
from nvsim.processes.messages import send
from nvsim.render import kernel_cache
from nvsim.training import compilation


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda module: tmp_path)
    return tmp_path


def compile_nothing(connection: Connection, done: Path) -> None:
    done.touch()
    send(connection, "")


def fail(connection: Connection, done: Path) -> None:
    send(connection, "no room on the disk")


def never_end(connection: Connection, done: Path) -> None:
    send(connection, "")
    time.sleep(600)


def test_the_kernels_are_compiled_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_compile_once", compile_nothing)
    heard: list[Event] = []
    compilation.compile_ahead(heard.append)
    compilation.compile_ahead(heard.append)
    assert [type(e) for e in heard] == [Log]


def test_a_machine_that_cannot_compile_ahead_hears_why_and_tries_again(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compilation, "_compile_once", fail)
    heard: list[Event] = []
    compilation.compile_ahead(heard.append)
    compilation.compile_ahead(heard.append)
    warnings = [e for e in heard if isinstance(e, Warning)]
    assert len(warnings) == 2 and "no room on the disk" in warnings[0].text


def test_kernels_that_were_compiled_meanwhile_are_not_compiled_again(cache: Path) -> None:
    heard: list[Event] = []
    with compilation.compiling_ahead():
        until = time.monotonic() + 200
        while not compilation._stamp().exists() and time.monotonic() < until:
            time.sleep(0.1)
        compilation.compile_ahead(heard.append)
    assert not heard


def test_compiling_ends_with_the_work_beside_it(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_compile_once", never_end)
    before = set(psutil.Process().children())
    with pytest.raises(InputError), compilation.compiling_ahead():
        (child,) = set(psutil.Process().children()) - before
        raise InputError("The capture is empty.")
    assert not child.is_running()
    with compilation.compiling_ahead(wanted=False):
        assert set(psutil.Process().children()) == before


def test_other_sources_are_compiled_again(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "nvsim"
    (package / "render").mkdir(parents=True)
    (package / "render" / "kernel.py").write_text("a = 1")
    monkeypatch.setattr(kernel_cache.nvsim, "__file__", str(package / "__init__.py"))
    first = compilation._stamp()
    assert compilation._stamp() == first
    (package / "render" / "kernel.py").write_text("a = 2")
    assert compilation._stamp() != first


AFTERWARDS = """
import dataclasses, sys
from numba.core.dispatcher import Dispatcher
from nvsim.training import compilation
from nvsim.training.config import PRESETS, preset
from nvsim.training.synthetic import synthetic_room
from nvsim.training.trainer import train_submap

def compiled():
    found = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("nvsim.")]:
        for kernel in vars(module).values():
            if isinstance(kernel, Dispatcher):
                found[f"{kernel.__module__}.{kernel.__qualname__}"] = set(kernel.signatures)
    return found

compilation._train_in_small()
ahead = compiled()
assert len(ahead) > 10
room = synthetic_room(5, 80, 56, 300)
for name in PRESETS:
    for threads in (1, 2):
        config = dataclasses.replace(preset(name), steps=30, gaussian_cap=700, threads=threads, checkpoint_seconds=0.0)
        train_submap(room.views, room.cloud, room.floor, dataclasses.replace(config, steps=16))
        train_submap(room.views, None, room.floor, config)
more = {name: found - ahead.get(name, set()) for name, found in compiled().items() if found - ahead.get(name, set())}
assert not more, more
"""


def test_nothing_is_left_to_compile_for_any_preset_and_number_of_threads() -> None:
    child = subprocess.run([sys.executable, "-c", AFTERWARDS], capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
