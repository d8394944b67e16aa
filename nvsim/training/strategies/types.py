"""What a strategy sees of a model, and the two moments of a step at which it is asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.splats.types import Gaussians

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Refinement:
    """kept    (K,) indices of the Gaussians that stay, with their moments
    born       those that join after them, without moments
    parents    (len(born),) for each of them the one that it came from, as it was before
    """

    kept: NDArray[np.int64]
    born: Gaussians
    parents: NDArray[np.int64]

    @property
    def count(self) -> int:
        return len(self.kept) + len(self.born)


class Model(Protocol):
    """The Gaussians under training. `gaussians` and `gradients` are the live arrays."""

    @property
    def gaussians(self) -> Gaussians: ...

    @property
    def gradients(self) -> Gaussians: ...

    @property
    def sums(self) -> Float32:
        """(N, 3) since the last refinement: sum of the absolute screen gradients per half image, number of views that
        drew the Gaussian, its largest 3-sigma radius as a share of the longer image side."""
        ...

    def refine(self, refinement: Refinement) -> None:
        """Replaces the Gaussians and clears `sums`."""
        ...

    def forget(self, name: str) -> None:
        """Clears both moments of one of the Gaussians' arrays."""
        ...


class Strategy(Protocol):
    """Steps count from 1. What a strategy remembers between steps is in the model, in the step's number or in the
    random generator it was given, so that a checkpoint of those is all it needs."""

    def before_update(self, model: Model, step: int) -> None:
        """Called when the gradients of a step are known; may add to them."""
        ...

    def after_update(self, model: Model, step: int) -> None:
        """Called after the optimiser moved the parameters; may move, add and remove Gaussians."""
        ...


def mean_gradient(sums: Float32) -> Float32:
    """(N,) over the views that drew each Gaussian."""
    return np.asarray(sums[:, 0] / np.maximum(sums[:, 1], 1), np.float32)
