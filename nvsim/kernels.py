"""Numba's compiler for this package. Modules with kernels import `njit` and `prange` from here.

Numba compiles a cached kernel again if the kernel's own file changes. But a kernel also contains functions and
constants of other files, so after an update of NVSim it could compute with an old function. On its first import in a
process, this module therefore removes all cached kernels if a file that they depend on has changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import numba
from numba import njit, prange

from nvsim import kernel_folder
from nvsim.errors import InputError
from nvsim.files import atomic

__all__ = ["njit", "prange", "remove_outdated"]

_RECORD = "kernels.sha256"


def remove_outdated(package: Path) -> None:
    """Removes the cached kernels of a `package` that were compiled from other sources than those it has now."""
    sources = _sources(package)
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(f"{path.relative_to(package)}\n".encode() + sources[path])
    now, folders = digest.hexdigest(), {path.parent for path in sources}
    places: list[Callable[[Path], Path]] = [lambda folder: folder / "__pycache__"]
    places.append(lambda folder: kernel_folder.user_cache() / _name(folder))
    chosen = getattr(numba.config, "CACHE_DIR", "")
    if chosen:
        places.insert(0, lambda folder: Path(chosen) / _name(folder))
    used = next((place for place in places if kernel_folder.can_write(place(package))), None)
    for place in places:
        record = place(package) / _RECORD
        with contextlib.suppress(OSError, InputError):
            if record.is_file() and record.read_bytes() == now.encode():
                continue
            # Without its index, a kernel is compiled again.
            outdated = [index for folder in folders for index in place(folder).glob("*.nbi")]
            for index in outdated:
                index.unlink(missing_ok=True)
            if outdated or place is used:
                record.parent.mkdir(parents=True, exist_ok=True)
                atomic.write_text(record, now)


def _sources(package: Path) -> dict[Path, bytes]:
    """The files of a `package` with kernels, and the files that these import, with their content."""
    every = {path: path.read_bytes() for path in package.rglob("*.py") if path.is_file()}  # an editor may leave links
    found = {path for path, text in every.items() if b".kernels import" in text}
    for path in list(found):
        for module in re.findall(rb"^from %s\.([\w.]+) import" % package.name.encode(), every[path], re.MULTILINE):
            found.add(package.joinpath(*module.decode().split(".")).with_suffix(".py"))
    return {path: every[path] for path in found if path in every}


def _name(source: Path) -> str:
    """The name that numba gives to the folder of kernels from files in `source`, outside of that folder."""
    return f"{source.name}_{hashlib.sha1(str(source).encode()).hexdigest()}"


remove_outdated(Path(__file__).parent)
