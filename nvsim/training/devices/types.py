"""The interface to the Gaussians under training, independent of the device."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.training.config import RateConfig
from nvsim.training.strategies.types import GaussianModel, Refinement


class Stopwatch:
    """Milliseconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def record_lap(self, name: str) -> None:
        """Records the time since the last lap under `name`."""
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now


Float32 = NDArray[np.float32]
FIELDS = ("means", "log_scales", "quats", "opacity_logits", "sh")
FEATURES = "features"
"""The group of the features from which networks compute colors, with one row per Gaussian like those of FIELDS."""


class GaussianState(GaussianModel, Protocol):
    """All arrays with one row per Gaussian, with their gradients and moments. The interface uses only numpy arrays, so
    that losses, strategies, and checkpoints do not depend on the device."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the groups: FIELDS, and FEATURES if a network computes colors."""
        ...

    @property
    def features(self) -> Float32 | None:
        """(N, F) features of the colors; None without a color network."""
        ...

    def __len__(self) -> int: ...

    def draw(
        self, camera: Camera, sh_degree: int | None, antialiased: bool, watch: Stopwatch
    ) -> tuple[Float32, Float32]:
        """Color (H, W, 3) and transmittance (H, W) of the Gaussians, with the embedding of the last `Networks.look`."""
        ...

    def differentiate(self, transmittance: Float32, d_rgb: Float32, d_alpha: Float32, watch: Stopwatch) -> None:
        """Propagates the gradients `d_rgb` (H, W, 3) and `d_alpha` (H, W) of the last images. They reach the Gaussians,
        the weights of the color network, and the embedding. `transmittance` is (H, W). Adds to `sums`."""
        ...

    def step(self, count: int, scales: Mapping[str, float]) -> None:
        """Makes the `count`-th Adam update (from 1), with the rates of a group times its entry in `scales`."""
        ...

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All arrays that a step changes, of any shape; the names are equal on every device."""
        ...

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` (any shape) of `state`, also from another device."""
        ...

    def figures(self) -> dict[str, int]:
        """Figures of the last view for benchmarks: visible Gaussians, and intersections with tiles if counted."""
        ...


def rates_of(name: str, rate: RateConfig, sh_count: int) -> Float32 | float:
    """The learning rate of a group, (columns,) if the columns differ."""
    if name == "sh":
        return np.array([rate.sh_dc] * 3 + [rate.sh_rest] * (3 * sh_count - 3), np.float32)
    return float(getattr(rate, name))


def new_rows(name: str, refinement: Refinement, features: Float32 | None) -> Float32:
    """The rows (B, ...) that are added to a group. For FEATURES these are the parents' rows of `features` (N, F)."""
    if name == FEATURES:
        assert features is not None
        return features[refinement.parents]
    return np.asarray(getattr(refinement.born, name), np.float32)
