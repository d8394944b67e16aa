"""Strategy "capped": divides the Gaussians that need it most, never beyond the cap.

A large sum of absolute screen gradients indicates that one Gaussian represents several (AbsGS, Ye et al. 2024). Those
with the largest gradients are divided first (Mallick et al. 2024). A Gaussian is divided along its longest axis into
two with an equal total transmittance. There is no opacity reset, because short runs cannot recover from one.
"""

from __future__ import annotations

import numpy as np

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians
from nvsim.training.strategies.config import DensifyConfig
from nvsim.training.strategies.division import divide, find_removable
from nvsim.training.strategies.types import Float32, GaussianModel, Refinement, mean_gradient


class Capped:
    """The capped strategy. Without a `floor`, Gaussians under it are kept."""

    def __init__(self, config: DensifyConfig, steps: int, cap: int, floor: FloorSurface | None) -> None:
        self._config, self._steps, self._cap, self._floor = config, steps, cap, floor

    def before_update(self, model: GaussianModel, step: int) -> None:
        """Does nothing."""

    def after_update(self, model: GaussianModel, step: int) -> None:
        """Refines if it is due."""
        c = self._config
        if step % c.every == 0 and step <= c.stop * self._steps:
            model.refine(self.refined(model.gaussians, mean_gradient(model.sums), step >= c.start * self._steps))

    def refined(self, gaussians: Gaussians, gradient: Float32, grows: bool) -> Refinement:
        """The refinement for `gradient` (N,): the mean absolute screen gradient per half image since the last one."""
        c = self._config
        lost = find_removable(gaussians, c.prune_opacity, c.largest, self._floor)
        room = self._cap - (len(gaussians) - int(lost.sum()))
        budget = min(room, int(c.capped.growth * len(gaussians))) if grows else 0
        wanting = np.flatnonzero((gradient > c.capped.gradient) & ~lost)
        wanting = largest_gradients(wanting, gradient, budget)
        stays = ~lost
        stays[wanting] = False
        return Refinement(np.flatnonzero(stays), divide(gaussians, wanting), np.concatenate([wanting, wanting]))


def largest_gradients(wanting: np.ndarray, gradient: Float32, budget: int) -> np.ndarray:
    """At most `budget` of the indices `wanting` (W,), those with the largest `gradient` (N,), in order."""
    if budget <= 0:
        return wanting[:0]
    if len(wanting) <= budget:
        return wanting
    order = np.argsort(-gradient[wanting], kind="stable")
    return np.asarray(np.sort(wanting[order[:budget]]))
