"""The kernels of training, compiled ahead in a process of their own.

A kernel that a process has just compiled and the same one loaded from numba's cache may round differently: the body of
a parallel loop exists twice, compiled alone and compiled into its kernel, and which copy runs is decided when they are
linked. A run that was killed on its first day would go on with the other copy. So every process that trains loads.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import llvmlite.binding as llvm
import numba
from numba.core.caching import FunctionCache

import nvsim
from nvsim.events import Listener, Log, Warning, silent
from nvsim.files import atomic

STAGE = "train"
_SOURCES = ("geometry", "splats", "render", "training")


def compile_ahead(listen: Listener = silent) -> None:
    """Returns at once when this was done before on this machine with these sources; else after a minute or two. What
    goes wrong is a warning: the kernels are then compiled as they are needed."""
    done = _stamp()
    if done.exists():
        return
    with _alone(done.with_suffix(".lock")):
        if not done.exists():  # another process did it meanwhile
            _compile(done, listen)


def _compile(done: Path, listen: Listener) -> None:
    listen(Log("Compiling the kernels, once on this machine; this takes a minute or two.", STAGE))
    command = [sys.executable, "-m", "nvsim.training.compilation"]
    found = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
    if found.returncode != 0:
        last = (found.stderr.strip().splitlines() or ["no reason given"])[-1]
        listen(Warning(f"The kernels could not be compiled ahead ({last}); they are compiled while training.", STAGE))
        return
    atomic.write_text(done, "")


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """While no other process of this machine is in such a block; at once on a file system without locks."""
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):
            file = held.enter_context(open(path, "wb"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _stamp() -> Path:
    """An empty file in numba's cache, named after everything that the machine code depends on."""
    from nvsim.render import projection

    key = hashlib.sha256()
    root = Path(nvsim.__file__).parent
    for path in sorted(p for name in _SOURCES for p in (root / name).rglob("*.py")):
        key.update(path.read_bytes())
    for fact in (root, numba.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()):
        key.update(str(fact).encode())
    return _cache_folder(projection) / f"nvsim-{key.hexdigest()[:16]}.compiled"


def _cache_folder(module: object) -> Path:
    """Where numba keeps what it compiles of this package: beside the sources, or the user's cache."""
    for value in vars(module).values():
        cache = getattr(value, "_cache", None)
        if isinstance(cache, FunctionCache):
            return Path(cache.cache_path)
    raise LookupError(f"{module} has no kernel that is kept")


def _train_in_small() -> None:
    """A few steps of every preset on pictures of a few pixels: it calls what training calls."""
    from nvsim.training.config import PRESETS, preset
    from nvsim.training.synthetic import synthetic_room
    from nvsim.training.trainer import train_submap

    room = synthetic_room(4, 64, 48, 400)
    for name in PRESETS:
        config = dataclasses.replace(preset(name), steps=12, gaussian_cap=500, exposure=name == "nvsim")
        train_submap(room.views, room.cloud, room.floor, config)


if __name__ == "__main__":
    _train_in_small()
