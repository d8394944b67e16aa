"""The networks of one model: the embedding, and the background and color networks that use it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.splats.types import Appearance, Background, Gaussians
from nvsim.training.appearance import LinearColours, NetworkColours, baked
from nvsim.training.background.network import BackgroundNetwork
from nvsim.training.config import TrainingConfig
from nvsim.training.embedding import IndexEmbedding, PositionEmbedding, embedding_of
from nvsim.training.optimizer import Group
from nvsim.training.parameters import send_back
from nvsim.training.views import TrainingView

Float32 = NDArray[np.float32]


class Networks:
    """One embedding is the input of both networks, as in Splatfacto-W. A view begins with `look` and ends with `learn`.

    colour   (3,) the initial background color, 0 to 1
    """

    def __init__(
        self, views: Sequence[TrainingView], config: TrainingConfig, seed: int, colour: NDArray[np.floating]
    ) -> None:
        appearance = config.appearance
        self._config = config
        self.embedding: PositionEmbedding | IndexEmbedding = embedding_of(appearance, views, seed)
        self.background = BackgroundNetwork(appearance, seed, colour) if config.background else None
        self.colours: LinearColours | NetworkColours | None = None
        if appearance.kind == "linear":
            self.colours = LinearColours(appearance, seed)
        elif appearance.kind == "network":
            self.colours = NetworkColours(appearance, seed, (config.sh_degree + 1) ** 2)
        self._middle = np.mean([view.camera.position for view in views], axis=0)
        self._taken = self.seen = torch.zeros(0)
        self._coefficients = torch.zeros(0)

    def groups(self) -> dict[str, Group]:
        """The parameters that the optimizer updates, by name, without the features of the Gaussians."""
        rate = self._config.rate
        groups = {"embedding": Group.of(self.embedding.values, rate.embedding, self.embedding.gradient)}
        if self.background is not None:
            groups["network"] = Group.of(self.background.values, rate.network, self.background.gradient)
        if self.colours is not None:
            groups["colours"] = Group.of(self.colours.values, rate.network, self.colours.gradient)
        return groups

    def look(self, position: NDArray[np.floating], name: str | None = None) -> None:
        """Selects the embedding of the training view `name`, or, without a name, of another view at `position` (3,)."""
        self._taken = self.embedding.at(position, name)
        self.seen = self._taken.detach().requires_grad_()
        for part in (self.embedding, self.background, self.colours):
            if part is not None:
                part.gradient[:] = 0

    def backdrop(self, share: float) -> Float32:
        """(25, 3) coefficients of the background after `share` of the steps."""
        assert self.background is not None
        interval = self._config.appearance.background_interval
        degree = min(4, int(share / interval)) if interval > 0 else 4
        self._coefficients = self.background.at(self.seen, degree)
        return np.asarray(self._coefficients.detach().numpy(), np.float32)

    def backdrop_gradient(self, d_coefficients: Float32) -> None:
        """Propagates the gradient `d_coefficients` (25, 3) of the last `backdrop`."""
        send_back(self._coefficients, torch.from_numpy(d_coefficients))

    def learn(self) -> None:
        """Propagates the gradients of the background and the colors through the embedding."""
        if self.seen.grad is not None and self._taken.requires_grad:
            send_back(self._taken, self.seen.grad)

    def exported_background(self) -> Background | None:
        """A copy without torch."""
        return None if self.background is None else self.background.exported(self.embedding.exported())

    def exported_colours(self, gaussians: Gaussians, features: Float32 | None) -> tuple[Gaussians, Appearance | None]:
        """The Gaussians with the coefficients to store, and a copy of the color network; `features` is (N, F)."""
        if self.colours is None or features is None:
            return gaussians, None
        appearance = self.colours.exported(self.embedding.exported(), features, self._middle)
        return baked(appearance, gaussians), appearance
