"""The numba cache of compiled kernels: its folder, and whether the kernels were compiled ahead of time."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import llvmlite.binding as llvm
import numba
from numba.core.caching import FunctionCache

import nvsim
from nvsim.files.opening import open_regular


def stamp(name: str, sources: Sequence[str]) -> Path:
    """The empty file in numba's cache that marks `name` as compiled ahead of time. Its name is a hash of everything
    that the machine code depends on: the Python files in the folders `sources` of the package, numba, and the
    processor."""
    from nvsim.render import projection

    key = hashlib.sha256()
    root = Path(nvsim.__file__).parent
    for path in sorted(p for folder in sources for p in (root / folder).rglob("*.py")):
        key.update(path.read_bytes())
    for fact in (root, numba.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()):
        key.update(str(fact).encode())
    return cache_folder(projection) / f"{name}-{key.hexdigest()[:16]}.compiled"


def cache_folder(module: object) -> Path:
    """The folder in which numba stores compiled kernels of this package: beside the sources, or in the user's cache.
    Raises LookupError for a module without kernels."""
    for value in vars(module).values():
        cache = getattr(value, "_cache", None)
        if isinstance(cache, FunctionCache):
            return Path(cache.cache_path)
    raise LookupError(f"{module} has no cached kernel")


@contextlib.contextmanager
def process_lock(path: Path) -> Iterator[None]:
    """Holds a lock that excludes other processes of this machine; without effect on a file system without locks."""
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):
            file = held.enter_context(open(open_regular(path, os.O_RDWR | os.O_CREAT), "rb+"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
