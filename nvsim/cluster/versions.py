"""The versions that decide whether two machines compute equal results: those of NVSim, Python and libraries."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import platform
from pathlib import Path

import nvsim

_LIBRARIES = ("numba", "numpy", "torch", "opencv-contrib-python-headless", "scipy")


@functools.cache
def versions() -> dict[str, str]:
    """Name -> version. The version of NVSim includes a hash of its sources, which change more often than its number."""
    found = {"NVSim": f"{nvsim.__version__} of sources {_sources()}", "Python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name).partition("+")[0]  # without "+cpu"
        except importlib.metadata.PackageNotFoundError:  # installed in another way
            found[name] = "unknown"
    return found


def _sources() -> str:
    digest = hashlib.sha256()
    root = Path(nvsim.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]
