"""Selects the backend: the numba kernels, which run anywhere, or gsplat, if it is installed and CUDA is available.

Both have one interface (nvsim.render.types). Torch and gsplat are imported only if gsplat is installed.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from functools import cache
from typing import Literal

from nvsim.errors import InputError

Backend = Literal["auto", "numba", "gsplat"]


def chosen(backend: Backend) -> Literal["numba", "gsplat"]:
    """Resolves "auto" to the backend of this machine. Raises InputError if gsplat is requested and cannot run."""
    if backend == "numba":
        return "numba"
    missing = missing_for_gsplat()
    if backend == "auto":
        return "gsplat" if missing is None else "numba"
    if missing is not None:
        raise InputError(f"The backend gsplat cannot run here: {missing}. Use the backend numba.")
    return "gsplat"


@cache
def missing_for_gsplat() -> str | None:
    """The reason why gsplat cannot run here, as the end of a sentence; None if it can."""
    if importlib.util.find_spec("gsplat") is None:
        return "gsplat is not installed (`pip install nvsim[gpu]`)"
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:  # tested without torch, whose import takes seconds
        return "there is no CUDA driver"
    import torch

    if not torch.cuda.is_available():
        return "PyTorch finds no CUDA GPU"
    return None
