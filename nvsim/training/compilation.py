"""Compiles the kernels of training ahead of time in a separate process.

A kernel that a process has just compiled, and one loaded from numba's cache, can round differently. The body of a
parallel loop exists twice, compiled alone and compiled into its kernel, and the linker decides which copy runs. A run
that was killed in the process that compiled its kernels could resume with the other copy. So every training process
loads them.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

from nvsim.events import Listener, Log, Warning, ignore_event
from nvsim.files import atomic
from nvsim.processes.messages import receive, send
from nvsim.processes.process import PipedProcess
from nvsim.render.kernel_cache import process_lock, stamp

STAGE = "train"
_SOURCES = ("geometry", "splats", "render", "training")


def compile_ahead(listen: Listener = ignore_event) -> None:
    """Compiles the kernels once for this machine and these sources, in a minute or two; later calls return at once. A
    failure is only a warning: the kernels are then compiled when they are needed. Raises InputError if no process can
    be started."""
    done = _stamp()
    if done.exists():
        return
    listen(Log("Compiling the kernels, once on this machine; this takes a minute or two.", STAGE))
    child = PipedProcess(_compile_once, done, hide_output=True)
    try:
        reason = receive(child.connection)
    except (EOFError, OSError):
        reason = "the process ended"
    finally:
        child.end()
    if reason:
        text = f"The kernels could not be compiled ahead ({reason}); they are compiled while training."
        listen(Warning(text, STAGE))


@contextlib.contextmanager
def compiling_ahead(wanted: bool = True) -> Iterator[None]:
    """Compiles the kernels on another core while the body runs, if `wanted` and if that was not done before. A later
    `compile_ahead` waits for it. It is stopped at the end of the body. Raises InputError if no process can be started.
    """
    done = _stamp() if wanted else None
    child = PipedProcess(_compile_once, done, hide_output=True) if done is not None and not done.exists() else None
    try:
        yield
    finally:
        if child is not None:
            child.end()


def _compile_once(connection: Connection, done: Path) -> None:
    """Compiles the kernels unless `done` exists, and then writes it. Sends the reason of a failure, or ""."""
    reason = ""
    try:
        with process_lock(done.with_suffix(".lock")):
            if not done.exists():  # another process can have done it meanwhile
                _train_in_small()
                atomic.write_text(done, "")
    except Exception as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
    send(connection, reason)


def _stamp() -> Path:
    return stamp("nvsim", _SOURCES)


def _train_in_small() -> None:
    """Trains every preset for a few steps on tiny images, which calls all kernels of training."""
    from nvsim.training.config import PRESETS, RobustConfig, preset
    from nvsim.training.synthetic import synthetic_room
    from nvsim.training.trainer import train_submap

    room = synthetic_room(4, 64, 48, 400)
    for name in PRESETS:
        config = dataclasses.replace(preset(name), steps=12, gaussian_cap=500, exposure=name == "nvsim", device="cpu")
        if name == "splatfacto-w":  # its presets for short runs have no robust mask
            config = dataclasses.replace(config, robust=RobustConfig(kind="quantile", start=0.0))
        train_submap(room.views, room.cloud, room.floor, config)
