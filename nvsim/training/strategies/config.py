"""The configuration of the strategies. Lengths are in meters and times are shares of all steps, so that the values fit
short runs and scenes of any size."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class CappedConfig:
    """Division of the Gaussians with the largest gradients, up to the cap."""

    growth: float = 0.1
    """Greatest share of the Gaussians that one refinement adds: those with the largest gradients."""
    gradient: float = 2e-4
    """Least mean absolute gradient, per half image, of a Gaussian that is divided."""


@dataclass(frozen=True)
class AdaptiveConfig:
    """Adaptive density control (Kerbl et al. 2023) with absolute gradients (AbsGS, Ye et al. 2024)."""

    gradient: float = 8e-4
    """Least mean absolute gradient, per half image, of a Gaussian that is cloned or split (Splatfacto)."""
    small: float = 0.05
    """Largest standard deviation up to which a Gaussian is cloned, and above which it is split in two; meters."""
    screen_split: float = 0.05
    """A Gaussian is split if its 3-sigma radius exceeds this share of the longer image side; 0 is never."""
    screen_cull: float = 0.15
    """A Gaussian is removed if its 3-sigma radius exceeds this share of the longer image side; 0 is never."""
    screen_stop: float = 0.13
    """Share of the steps at which the two rules about the radius end."""
    reset: float = 0.1
    """Share of the steps between two resets of the opacity, until growth stops; 0 is never."""
    reset_opacity: float = 0.2
    """Greatest opacity of a Gaussian after a reset."""
    pause: float = 0.02
    """Share of the steps after a reset in which no Gaussian is added or removed."""


@dataclass(frozen=True)
class McmcConfig:
    """3D Gaussian Splatting as Markov chain Monte Carlo (Kheradmand et al. 2024)."""

    dead: float = 0.005
    """A Gaussian with a lower opacity is dead, and is relocated to a live one."""
    growth: float = 0.05
    """Share of the Gaussians added by one refinement, up to the cap."""
    noise: float = 2e4
    """Noise on the means per learning rate and covariance in square meters: the paper's 5e5 at 5 m a unit."""
    opacity: float = 0.01
    """Weight of the mean opacity in the loss."""
    scale: float = 0.002
    """Weight of the mean standard deviation in meters: the paper's 0.01 at 5 m a unit."""


@dataclass(frozen=True)
class DensifyConfig:
    """The strategy, its schedule, and the limits for removal that all strategies share."""

    strategy: Literal["capped", "adaptive", "mcmc", "none"] = "capped"
    """The strategy by which the number of Gaussians grows; all respect the Gaussian cap."""
    every: int = 100
    """Steps between refinements; not a share, because a mean gradient needs a fixed number of views."""
    start: float = 0.1
    """Share of all steps at which growth begins."""
    stop: float = 0.7
    """Share of all steps at which growth ends."""
    prune_opacity: float = 0.02
    """Opacity below which a Gaussian is removed."""
    largest: float = 1.0
    """Standard deviation in meters above which a Gaussian is removed."""
    capped: CappedConfig = field(default_factory=CappedConfig)
    adaptive: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    mcmc: McmcConfig = field(default_factory=McmcConfig)
