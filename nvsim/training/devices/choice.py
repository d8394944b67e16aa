"""Selects the device of a configuration from those of this machine, and creates the Gaussians of a training on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nvsim.errors import InputError
from nvsim.render.backends import missing_for_gsplat

if TYPE_CHECKING:
    from nvsim.splats.types import Gaussians
    from nvsim.training.config import TrainingConfig
    from nvsim.training.devices.types import GaussianState
    from nvsim.training.networks import Networks


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


def hold_on_device(gaussians: Gaussians, networks: Networks | None, config: TrainingConfig) -> GaussianState:
    """The Gaussians on the device `config.device`. Raises InputError as `gpu_name` does."""
    place = gpu_name(config.device)
    if place is None:
        from nvsim.training.devices.host import HostGaussianState

        return HostGaussianState(gaussians, networks, config.rate)
    from nvsim.training.devices.card import CardGaussianState

    return CardGaussianState(gaussians, networks, config.rate, place)
