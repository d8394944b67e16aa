"""The device that a configuration names, as far as this machine has it."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.render.backends import missing_for_gsplat
from nvsim.splats.types import Gaussians
from nvsim.training.config import TrainingConfig
from nvsim.training.devices.host import OnHost
from nvsim.training.devices.types import Held
from nvsim.training.networks import Networks


def card(device: str) -> str | None:
    """The card that `device` ("auto", "cpu" or "cuda") stands for here, as torch names it; None is the CPU. Raises
    InputError when a card is asked for and cannot be used."""
    if device == "cpu":
        return None
    missing = missing_for_gsplat()
    if missing is None:
        return "cuda"
    if device == "cuda":
        raise InputError(f"Training cannot run on a card here: {missing}. Take --device cpu.")
    return None


def held_on(gaussians: Gaussians, networks: Networks | None, config: TrainingConfig) -> Held:
    """The Gaussians where `config.device` wants them. Raises InputError as `card` does."""
    place = card(config.device)
    if place is None:
        return OnHost(gaussians, networks, config.rate)
    from nvsim.training.devices.card import OnCard

    return OnCard(gaussians, networks, config.rate, place)
