"""The background network in torch: appearance embedding -> 25 SH coefficients (paper, section III-C; Splatfacto-W)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.splats.embedding import Embedding
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Background, Float32
from nvsim.training.config import AppearanceConfig
from nvsim.training.parameters import Parameters, generator_of

COEFFICIENTS = 25


class BackgroundNetwork:
    """Starts with `colour` (3,) in every direction: the head of the other coefficients starts at zero
    (Splatfacto-W)."""

    def __init__(self, config: AppearanceConfig, seed: int, colour: NDArray[np.floating]) -> None:
        layers, previous = {}, config.size
        self._depth = config.background_layers - 1
        for i in range(self._depth):
            layers[f"trunk.{i}"] = (config.background_width, previous)
            previous = config.background_width
        layers |= {"base": (3, previous), "rest": (3 * (COEFFICIENTS - 1), previous)}
        self._parameters = Parameters(layers, generator_of(seed, 1), zero=("rest",))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient
        tensors = self._parameters.tensors
        with torch.no_grad():
            tensors["base.weight"].mul_(0.1)
            tensors["base.bias"].copy_(torch.from_numpy(np.asarray(colour, np.float32) / DC))

    def at(self, embedding: torch.Tensor, degree: int = 4) -> torch.Tensor:
        """(25, 3) coefficients for `embedding` (E,); those above `degree` are zero."""
        h = embedding
        for i in range(self._depth):
            h = torch.relu(self._parameters.linear(f"trunk.{i}", h))
        base, rest = self._parameters.linear("base", h), self._parameters.linear("rest", h)
        used = (degree + 1) ** 2 - 1
        rest = rest.view(COEFFICIENTS - 1, 3)
        if used < len(rest):
            rest = torch.cat([rest[:used], torch.zeros_like(rest[used:])])
        return torch.cat([base[None], rest])

    def exported(self, embedding: Embedding) -> Background:
        """A copy without torch, together with its embedding."""
        weights: dict[str, Float32] = {**embedding.weights, **self._parameters.exported()}
        return Background(weights, embedding.octaves, embedding.period, embedding.nearest)
