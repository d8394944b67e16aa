"""Which backend draws: the numba kernels, which run anywhere, or gsplat, where it is installed and CUDA is there.

Both answer the same contract (nvsim.render.types). Torch and gsplat are imported only where gsplat is installed.
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
    """What "auto" means here, and the others as they are. Raises InputError when gsplat is asked for and cannot run."""
    if backend == "numba":
        return "numba"
    missing = missing_for_gsplat()
    if backend == "auto":
        return "gsplat" if missing is None else "numba"
    if missing is not None:
        raise InputError(f"The backend gsplat cannot run here: {missing}. Take the backend numba.")
    return "gsplat"


@cache
def missing_for_gsplat() -> str | None:
    """What keeps gsplat from running here, as the end of a sentence; None when nothing does."""
    if importlib.util.find_spec("gsplat") is None:
        return "gsplat is not installed (`pip install nvsim[gpu]`)"
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:  # found out without torch, which takes seconds to import
        return "there is no CUDA driver"
    import torch

    if not torch.cuda.is_available():
        return "PyTorch sees no CUDA card"
    return None
