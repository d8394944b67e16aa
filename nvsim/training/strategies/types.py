"""The interface between strategies and the model: its state, the refinement, and the two calls in each step."""

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
    born       new Gaussians (B) appended after them, without moments
    parents    (B,) for each new Gaussian, the index of its parent before the refinement
    """

    kept: NDArray[np.int64]
    born: Gaussians
    parents: NDArray[np.int64]

    @property
    def count(self) -> int:
        return len(self.kept) + len(self.born)


class GaussianModel(Protocol):
    """The Gaussians under training."""

    @property
    def gaussians(self) -> Gaussians:
        """Arrays that can be changed in place until the next call."""
        ...

    @property
    def gradients(self) -> Gaussians:
        """The gradients, which can be changed in place until the next call."""
        ...

    @property
    def sums(self) -> Float32:
        """(N, 3) statistics since the last refinement: sum of the absolute screen gradients per half image, number of
        views that drew the Gaussian, and its largest 3-sigma radius as a share of the longer image side."""
        ...

    def refine(self, refinement: Refinement) -> None:
        """Replaces the Gaussians and sets `sums` to zero. Survivors keep their moments, new ones start with zero
        moments."""
        ...

    def reset_moments(self, name: str) -> None:
        """Sets both moments of one of the Gaussians' arrays to zero."""
        ...


class Strategy(Protocol):
    """A densification strategy. Steps count from 1. All state between steps is in the model, the step number, and the
    random generator, so a checkpoint needs only these."""

    def before_update(self, model: GaussianModel, step: int) -> None:
        """Called when the gradients of a step are known; can add to them."""
        ...

    def after_update(self, model: GaussianModel, step: int) -> None:
        """Called after the optimizer updated the parameters; can move, add, and remove Gaussians."""
        ...


def mean_gradient(sums: Float32) -> Float32:
    """(N,) mean gradient over the views that drew each Gaussian, from `sums` (N, 3)."""
    return np.asarray(sums[:, 0] / np.maximum(sums[:, 1], 1), np.float32)
