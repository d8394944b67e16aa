"""What a fit asks of the Gaussians under training, wherever they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.splats.types import Gaussians
from nvsim.training.config import RateConfig
from nvsim.training.stopwatch import Stopwatch
from nvsim.training.strategies.types import Refinement

Float32 = NDArray[np.float32]
FIELDS = ("means", "log_scales", "quats", "opacity_logits", "sh")
FEATURES = "features"
"""The group of what the networks colour Gaussians from, a row per Gaussian as in those of FIELDS."""


class Held(Protocol):
    """Every array that has a row per Gaussian, with its gradient and moments. All that is handed over is numpy, so that
    losses, strategies and checkpoints are the same for every device."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the groups: FIELDS, and FEATURES where networks colour."""
        ...

    @property
    def gaussians(self) -> Gaussians:
        """Arrays that may be changed in place until the next call."""
        ...

    @property
    def gradients(self) -> Gaussians:
        """Likewise."""
        ...

    @property
    def features(self) -> Float32 | None:
        """(N, F) where networks colour."""
        ...

    @property
    def sums(self) -> Float32:
        """(N, 3) as `strategies.types.Model` says."""
        ...

    def __len__(self) -> int: ...

    def draw(
        self, camera: Camera, sh_degree: int | None, antialiased: bool, watch: Stopwatch
    ) -> tuple[Float32, Float32]:
        """Colour (H, W, 3) and transmittance (H, W) as the embedding that was last looked at makes them."""
        ...

    def differentiate(self, transmittance: Float32, d_rgb: Float32, d_alpha: Float32, watch: Stopwatch) -> None:
        """From the gradients by the images that were last drawn to all others: those here, those of the colours'
        weights, and that by the embedding. Adds to `sums`."""
        ...

    def step(self, count: int, scales: Mapping[str, float]) -> None:
        """The `count`-th update (from 1) of Adam, with the rates of a group times its entry in `scales`."""
        ...

    def refine(self, refinement: Refinement) -> None:
        """The survivors keep their moments, the new ones start with none."""
        ...

    def forget(self, name: str) -> None:
        """Clears both moments of a group."""
        ...

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that a step changes, by the same names on every device."""
        ...

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """The inverse of `state`, that of another device too."""
        ...

    def figures(self) -> dict[str, int]:
        """What a benchmark tells of the last view: visible Gaussians, and intersections with tiles where counted."""
        ...


def rates_of(name: str, rate: RateConfig, sh_count: int) -> Float32 | float:
    """The learning rate of a group, per column where columns differ."""
    if name == "sh":
        return np.array([rate.sh_dc] * 3 + [rate.sh_rest] * (3 * sh_count - 3), np.float32)
    return float(getattr(rate, name))


def born_of(name: str, refinement: Refinement, features: Float32 | None) -> Float32:
    """The rows that join a group; of FEATURES they are those of the parents."""
    if name == FEATURES:
        assert features is not None
        return features[refinement.parents]
    return np.asarray(getattr(refinement.born, name), np.float32)
