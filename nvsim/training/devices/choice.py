"""Selects the device of a configuration from those of this machine."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.render.backends import missing_for_gsplat


def gpu_name(device: str) -> str | None:
    """The torch name of the GPU for `device` ("auto", "cpu", or "cuda"); None for the CPU. Raises InputError if "cuda"
    is given and no GPU can be used."""
    if device == "cpu":
        return None
    missing = missing_for_gsplat()
    if missing is None:
        return "cuda"
    if device == "cuda":
        raise InputError(f"No CUDA GPU can be used here: {missing}. Use --device cpu.")
    return None
