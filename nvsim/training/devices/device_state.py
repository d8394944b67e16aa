"""Creates the Gaussians of a training on the device of its configuration."""

from __future__ import annotations

from nvsim.splats.types import Gaussians
from nvsim.training.config import TrainingConfig
from nvsim.training.devices import choice
from nvsim.training.devices.host import HostGaussianState
from nvsim.training.devices.types import GaussianState
from nvsim.training.networks import Networks


def hold_on_device(gaussians: Gaussians, networks: Networks | None, config: TrainingConfig) -> GaussianState:
    """The Gaussians on the device `config.device`. Raises InputError as `choice.gpu_name` does."""
    place = choice.gpu_name(config.device)
    if place is None:
        return HostGaussianState(gaussians, networks, config.rate)
    from nvsim.training.devices.card import CardGaussianState

    return CardGaussianState(gaussians, networks, config.rate, place)
