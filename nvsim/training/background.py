"""The background network in torch: camera position -> appearance embedding -> 25 SH coefficients (paper, III-C).

Its weights carry the names and shapes of `nvsim.splats.types.Background`, and lie in one flat vector so that one
optimiser call moves them all.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.splats.types import Background

EMBED = (64, 24)
"""Widths of the embedding's layers; the last is the size of the appearance embedding."""
TRUNK = (128, 128)
"""With its two heads these are the three layers of Splatfacto-W's background model."""
OCTAVES, PERIOD = 4, 5.0
COEFFICIENTS = 25


class BackgroundNetwork(torch.nn.Module):
    """`colour` (3,) is the constant colour it starts with; the rest head starts at zero, as in Splatfacto-W."""

    def __init__(self, seed: int, colour: NDArray[np.floating]) -> None:
        super().__init__()
        sizes, previous = {}, 3 * (1 + 2 * OCTAVES)
        for part, widths in (("embed", EMBED), ("trunk", TRUNK)):
            for i, width in enumerate(widths):
                sizes[f"{part}.{i}"] = (width, previous)
                previous = width
        sizes["base"], sizes["rest"] = (3, previous), (3 * (COEFFICIENTS - 1), previous)
        count = sum(rows * (columns + 1) for rows, columns in sizes.values())
        self.values = np.zeros((count, 1), np.float32)
        self.gradient = np.zeros_like(self.values)
        self._weights: dict[str, torch.nn.Parameter] = {}
        generator = torch.Generator().manual_seed(seed)
        at = 0
        for name, (rows, columns) in sizes.items():
            bound = columns**-0.5
            for kind, shape in (("weight", (rows, columns)), ("bias", (rows,))):
                end = at + int(np.prod(shape))
                parameter = torch.nn.Parameter(torch.from_numpy(self.values[at:end, 0]).view(shape))
                parameter.grad = torch.from_numpy(self.gradient[at:end, 0]).view(shape)
                if name != "rest":
                    with torch.no_grad():
                        parameter.uniform_(-bound, bound, generator=generator)
                self._weights[f"{name}.{kind}"] = parameter
                at = end
        with torch.no_grad():
            self._weights["base.weight"].mul_(0.1)
            self._weights["base.bias"].copy_(torch.from_numpy(np.asarray(colour, np.float32) / 0.28209479))
        for name, parameter in self._weights.items():
            self.register_parameter(name.replace(".", "_"), parameter)

    def forward(self, position: torch.Tensor) -> torch.Tensor:
        """(25, 3) coefficients seen from `position` (3,) float32, metres, world."""
        w, relu, linear = self._weights, torch.nn.functional.relu, torch.nn.functional.linear
        x = position / PERIOD
        phases = x[:, None] * (2.0 ** torch.arange(OCTAVES))
        h = torch.cat([x[:, None], torch.sin(phases), torch.cos(phases)], dim=1).reshape(-1)
        for i in range(len(EMBED)):
            h = linear(h, w[f"embed.{i}.weight"], w[f"embed.{i}.bias"])
            if i < len(EMBED) - 1:
                h = relu(h)
        for i in range(len(TRUNK)):
            h = relu(linear(h, w[f"trunk.{i}.weight"], w[f"trunk.{i}.bias"]))
        base = linear(h, w["base.weight"], w["base.bias"])
        rest = linear(h, w["rest.weight"], w["rest.bias"])
        return torch.cat([base[None], rest.view(COEFFICIENTS - 1, 3)])

    def exported(self) -> Background:
        """A copy without torch."""
        weights = {name: p.detach().numpy().copy() for name, p in self._weights.items()}
        return Background(weights, OCTAVES, PERIOD)
