"""The configuration of the strategies. Lengths are metres, times are shares of all steps, so that short runs and scenes
of any size are treated alike."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class CappedConfig:
    """Division of the neediest Gaussians under the cap."""

    growth: float = 0.1
    """At most this share of the Gaussians is added by one refinement: those with the largest gradients."""
    gradient: float = 2e-4
    """Least mean absolute gradient, per half image, of a Gaussian worth dividing."""


@dataclass(frozen=True)
class AdaptiveConfig:
    """Adaptive density control (Kerbl et al. 2023) with absolute gradients (AbsGS, Ye et al. 2024)."""

    gradient: float = 8e-4
    """Least mean absolute gradient, per half image, of a Gaussian that is cloned or split (Splatfacto)."""
    small: float = 0.05
    """A Gaussian whose largest standard deviation is at most this is cloned, a larger one split in two; metres."""
    screen_split: float = 0.05
    """A Gaussian whose 3-sigma radius exceeds this share of the longer image side is split; 0 is never."""
    screen_cull: float = 0.15
    """One whose radius exceeds this share is removed; 0 is never."""
    screen_stop: float = 0.13
    """The share of the steps at which both rules of the screen end."""
    reset: float = 0.1
    """Share of the steps between two resets of the opacity, until growth stops; 0 is never."""
    reset_opacity: float = 0.2
    """No Gaussian is more opaque than this after a reset."""
    pause: float = 0.02
    """Share of the steps after a reset in which nothing grows and nothing is removed."""


@dataclass(frozen=True)
class McmcConfig:
    """3D Gaussian Splatting as Markov chain Monte Carlo (Kheradmand et al. 2024)."""

    dead: float = 0.005
    """A Gaussian fainter than this is dead, and relocated to a live one."""
    growth: float = 0.05
    """Share of the Gaussians added by one refinement, up to the cap."""
    noise: float = 2e4
    """Noise on the means per learning rate and covariance in square metres: the paper's 5e5 at 5 m a unit."""
    opacity: float = 0.01
    """Weight of the mean opacity in the loss."""
    scale: float = 0.002
    """Weight of the mean standard deviation in metres: the paper's 0.01 at 5 m a unit."""


@dataclass(frozen=True)
class DensifyConfig:
    """Which strategy, when, and what every strategy removes."""

    strategy: Literal["capped", "adaptive", "mcmc", "none"] = "capped"
    """What the model grows by; all keep to the Gaussian cap."""
    every: int = 100
    """Steps between refinements; not a share, because a mean gradient needs as many views whatever the run's length."""
    start: float = 0.1
    """The share of all steps at which the model begins to grow."""
    stop: float = 0.7
    """The share at which growth ends."""
    prune_opacity: float = 0.02
    """Fainter Gaussians are removed."""
    largest: float = 1.0
    """Standard deviation in metres above which a Gaussian is removed."""
    capped: CappedConfig = field(default_factory=CappedConfig)
    adaptive: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    mcmc: McmcConfig = field(default_factory=McmcConfig)
