"""The backends: the numba kernels, which run anywhere, or gsplat, if it is installed and CUDA is present; and their
output.

Both have one interface. Torch and gsplat are imported only if gsplat is installed.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from nvsim.errors import InputError
from nvsim.render.kernel_types import Float32


@dataclass(eq=False)
class RenderOutput:
    """A view. A channel that was not requested is None.

    rgb        (H, W, 3) float32, not clamped: Gaussians over the background, if there is one
    alpha      (H, W) float32, accumulated opacity of the Gaussians alone, 0 to 1
    depth      (H, W) float32, meters along the optical axis, alpha-weighted mean of the Gaussians' depths divided by
               alpha; 0 where alpha < 1e-3
    normal     (H, W, 3) float32, world, toward the camera: sum of weight * (the Gaussian's shortest axis); length <= 1
    """

    rgb: Float32 | None = None
    alpha: Float32 | None = None
    depth: Float32 | None = None
    normal: Float32 | None = None


ALPHA_OF_DEPTH = np.float32(1e-3)
"""Alpha below which a pixel has no depth."""


def expected_depth(weighted: Float32, alpha: Float32) -> Float32:
    """Weighted sum of depths over alpha, 0 where alpha is below ALPHA_OF_DEPTH; all (H, W)."""
    mean = weighted / np.maximum(alpha, ALPHA_OF_DEPTH)
    return np.where(alpha < ALPHA_OF_DEPTH, np.float32(0), mean)


Backend = Literal["auto", "numba", "gsplat"]


def resolve_backend(backend: Backend) -> Literal["numba", "gsplat"]:
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
