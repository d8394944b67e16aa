"""Compiles the kernels of training ahead of time in a separate process.

A kernel that a process has just compiled, and one loaded from numba's cache, can round differently. The body of a
parallel loop exists twice, compiled alone and compiled into its kernel, and the linker decides which copy runs. A run
that was killed in the process that compiled its kernels could resume with the other copy. So every training process
loads them.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

from nvsim.events import Listener, Log, Warning, ignore_event
from nvsim.files import atomic
from nvsim.render.kernel_cache import process_lock, stamp

STAGE = "train"
_SOURCES = ("geometry", "splats", "render", "training")


def compile_ahead(listen: Listener = ignore_event) -> None:
    """Compiles the kernels once for this machine and these sources, in a minute or two; later calls return at once. A
    failure is only a warning: the kernels are then compiled when they are needed."""
    done = _stamp()
    if done.exists():
        return
    with process_lock(done.with_suffix(".lock")):
        if not done.exists():  # another process can have done it meanwhile
            _compile(done, listen)


def _compile(done: Path, listen: Listener) -> None:
    listen(Log("Compiling the kernels, once on this machine; this takes a minute or two.", STAGE))
    command = [sys.executable, "-P", "-m", "nvsim.training.compilation"]
    found = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
    if found.returncode != 0:
        last = (found.stderr.strip().splitlines() or ["no reason given"])[-1]
        listen(Warning(f"The kernels could not be compiled ahead ({last}); they are compiled while training.", STAGE))
        return
    atomic.write_text(done, "")


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


if __name__ == "__main__":
    _train_in_small()
