"""Selects the strategy of a configuration. Strategy "none" never adds or removes Gaussians."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.training.config import TrainingConfig
from nvsim.training.strategies.adaptive import Adaptive, Capped
from nvsim.training.strategies.mcmc import Mcmc
from nvsim.training.strategies.types import GaussianModel, Strategy


class Fixed:
    """The strategy without densification."""

    def before_update(self, model: GaussianModel, step: int) -> None:
        """Does nothing."""

    def after_update(self, model: GaussianModel, step: int) -> None:
        """Does nothing."""


def strategy_of(config: TrainingConfig, floor: FloorSurface, rng: np.random.Generator) -> Strategy:
    """The strategy of a configuration. `rng` is used during training, so checkpoints must contain its state."""
    c, steps, cap = config.densify, config.steps, config.gaussian_cap
    ground = floor if config.floor_aware else None
    match c.strategy:
        case "adaptive":
            return Adaptive(c, steps, cap, ground, rng)
        case "mcmc":
            return Mcmc(c, steps, cap, ground, rng, config.rate.means, config.rate.means_end)
        case "capped":
            return Capped(c, steps, cap, ground)
        case "none":
            return Fixed()
