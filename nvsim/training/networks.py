"""The networks of one model: the embedding, and the background and color networks that use it (paper, section III-C;
Splatfacto-W). The appearance embedding is a function of the camera position, one vector per training image, or one
vector for all (see `nvsim.splats.types`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.splats.harmonics import DC
from nvsim.splats.types import Appearance, Background, Embedding, Gaussians
from nvsim.training.appearance import LinearColors, NetworkColors, baked
from nvsim.training.config import AppearanceConfig, TrainingConfig
from nvsim.training.optimizer import ParameterGroup, Parameters, propagate_gradient, random_generator
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
        self._parameters = Parameters(layers, random_generator(seed, 0))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient

    def embedding_at(self, position: NDArray[np.floating], name: str | None) -> torch.Tensor:
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
        start = torch.randn((len(self._positions), config.size), generator=random_generator(seed, 0))
        self.values = start.numpy()
        self.gradient = np.zeros_like(self.values)
        self._vectors = torch.from_numpy(self.values).requires_grad_()
        self._vectors.grad = torch.from_numpy(self.gradient)

    def embedding_at(self, position: NDArray[np.floating], name: str | None) -> torch.Tensor:
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


COEFFICIENTS = 25


class BackgroundNetwork:
    """Starts with `color` (3,) in every direction: the head of the other coefficients starts at zero
    (Splatfacto-W)."""

    def __init__(self, config: AppearanceConfig, seed: int, color: NDArray[np.floating]) -> None:
        layers, previous = {}, config.size
        self._depth = config.background_layers - 1
        for i in range(self._depth):
            layers[f"trunk.{i}"] = (config.background_width, previous)
            previous = config.background_width
        layers |= {"base": (3, previous), "rest": (3 * (COEFFICIENTS - 1), previous)}
        self._parameters = Parameters(layers, random_generator(seed, 1), zero=("rest",))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient
        tensors = self._parameters.tensors
        with torch.no_grad():
            tensors["base.weight"].mul_(0.1)
            tensors["base.bias"].copy_(torch.from_numpy(np.asarray(color, np.float32) / DC))

    def coefficients(self, embedding: torch.Tensor, degree: int = 4) -> torch.Tensor:
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


class Networks:
    """One embedding is the input of both networks, as in Splatfacto-W. A view begins with `select_embedding` and ends
    with `propagate_gradients`.

    color   (3,) the initial background color, 0 to 1
    """

    def __init__(
        self, views: Sequence[TrainingView], config: TrainingConfig, seed: int, color: NDArray[np.floating]
    ) -> None:
        appearance = config.appearance
        self._config = config
        self.embedding: PositionEmbedding | IndexEmbedding = embedding_of(appearance, views, seed)
        self.background = BackgroundNetwork(appearance, seed, color) if config.background else None
        self.colors: LinearColors | NetworkColors | None = None
        if appearance.kind == "linear":
            self.colors = LinearColors(appearance, seed)
        elif appearance.kind == "network":
            self.colors = NetworkColors(appearance, seed, (config.sh_degree + 1) ** 2)
        self._middle = np.mean([view.camera.position for view in views], axis=0)
        self._taken = self.seen = torch.zeros(0)
        self._coefficients = torch.zeros(0)

    def groups(self) -> dict[str, ParameterGroup]:
        """The parameters that the optimizer updates, by name, without the features of the Gaussians."""
        rate = self._config.rate
        groups = {"embedding": ParameterGroup.of(self.embedding.values, rate.embedding, self.embedding.gradient)}
        if self.background is not None:
            groups["network"] = ParameterGroup.of(self.background.values, rate.network, self.background.gradient)
        if self.colors is not None:
            groups["colours"] = ParameterGroup.of(self.colors.values, rate.network, self.colors.gradient)
        return groups

    def select_embedding(self, position: NDArray[np.floating], name: str | None = None) -> None:
        """Selects the embedding of the training view `name`, or, without a name, of another view at `position` (3,)."""
        self._taken = self.embedding.embedding_at(position, name)
        self.seen = self._taken.detach().requires_grad_()
        for part in (self.embedding, self.background, self.colors):
            if part is not None:
                part.gradient[:] = 0

    def background_coefficients(self, share: float) -> Float32:
        """(25, 3) coefficients of the background after `share` of the steps."""
        assert self.background is not None
        interval = self._config.appearance.background_interval
        degree = min(4, int(share / interval)) if interval > 0 else 4
        self._coefficients = self.background.coefficients(self.seen, degree)
        return np.asarray(self._coefficients.detach().numpy(), np.float32)

    def backdrop_gradient(self, d_coefficients: Float32) -> None:
        """Propagates the gradient `d_coefficients` (25, 3) of the last `backdrop`."""
        propagate_gradient(self._coefficients, torch.from_numpy(d_coefficients))

    def propagate_gradients(self) -> None:
        """Propagates the gradients of the background and the colors through the embedding."""
        if self.seen.grad is not None and self._taken.requires_grad:
            propagate_gradient(self._taken, self.seen.grad)

    def exported_background(self) -> Background | None:
        """A copy without torch."""
        return None if self.background is None else self.background.exported(self.embedding.exported())

    def exported_colors(self, gaussians: Gaussians, features: Float32 | None) -> tuple[Gaussians, Appearance | None]:
        """The Gaussians with the coefficients to store, and a copy of the color network; `features` is (N, F)."""
        if self.colors is None or features is None:
            return gaussians, None
        appearance = self.colors.exported(self.embedding.exported(), features, self._middle)
        return baked(appearance, gaussians), appearance
