"""The appearance embedding during training (see `nvsim.splats.embedding`): a function of the camera position, one
vector per training image, or one vector for all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.splats.embedding import Embedding
from nvsim.training.config import AppearanceConfig
from nvsim.training.parameters import Parameters, generator_of
from nvsim.training.views import TrainingView

HIDDEN = 64
"""Width of the position network's hidden layer."""
OCTAVES, PERIOD = 4, 5.0

Float32 = NDArray[np.float32]


class PositionEmbedding:
    """A network of the camera position with one hidden layer (paper, section III-C)."""

    def __init__(self, config: AppearanceConfig, seed: int) -> None:
        inputs = 3 * (1 + 2 * OCTAVES)
        layers = {"embed.0": (HIDDEN, inputs), "embed.1": (config.size, HIDDEN)}
        self._parameters = Parameters(layers, generator_of(seed, 0))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient

    def at(self, position: NDArray[np.floating], name: str | None) -> torch.Tensor:
        """(E,) for a camera at `position` (3,), meters. The training view `name` is ignored."""
        x = torch.from_numpy(np.asarray(position, np.float32)) / PERIOD
        phases = x[:, None] * (2.0 ** torch.arange(OCTAVES))
        h = torch.cat([x[:, None], torch.sin(phases), torch.cos(phases)], dim=1).reshape(-1)
        return self._parameters.linear("embed.1", torch.relu(self._parameters.linear("embed.0", h)))

    def exported(self) -> Embedding:
        """A copy without torch."""
        return Embedding(self._parameters.exported(), OCTAVES, PERIOD)


class IndexEmbedding:
    """One vector per training view, initially standard normal (Splatfacto-W); with `shared`, one vector for all."""

    def __init__(self, config: AppearanceConfig, views: Sequence[TrainingView], seed: int, shared: bool) -> None:
        self._rows = {view.name: 0 if shared else i for i, view in enumerate(views)}
        self._positions = np.stack([view.camera.position for view in views]).astype(np.float32)
        if shared:
            self._positions = self._positions.mean(axis=0, keepdims=True)
        self._nearest = config.evaluation == "nearest"
        start = torch.randn((len(self._positions), config.size), generator=generator_of(seed, 0))
        self.values = start.numpy()
        self.gradient = np.zeros_like(self.values)
        self._vectors = torch.from_numpy(self.values).requires_grad_()
        self._vectors.grad = torch.from_numpy(self.gradient)

    def at(self, position: NDArray[np.floating], name: str | None) -> torch.Tensor:
        """(E,) the vector of the training view `name`. Without a name, the vector that the exported model uses at
        `position` (3,), meters."""
        if name is None:
            return torch.from_numpy(self.exported().at(position))
        return self._vectors[self._rows[name]]

    def exported(self) -> Embedding:
        """A copy without torch."""
        return Embedding(
            {"index.vectors": self.values.copy(), "index.positions": self._positions.copy()}, nearest=self._nearest
        )


def embedding_of(
    config: AppearanceConfig, views: Sequence[TrainingView], seed: int
) -> PositionEmbedding | IndexEmbedding:
    """The embedding of a configuration; for "none" one learned vector."""
    if config.embedding == "position":
        return PositionEmbedding(config, seed)
    return IndexEmbedding(config, views, seed, shared=config.embedding == "none")
