"""Where the model grows and what it loses: the adaptive density control of 3D Gaussian splatting under a cap.

Grows where the summed absolute screen gradients say that one Gaussian does the work of several (AbsGS, Ye et al. 2024),
the neediest first, and never beyond the cap (Mallick et al. 2024). A Gaussian is divided along its longest axis into
two that together let through what it let through. There is no opacity reset: runs are too short to recover from one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.splats.types import Gaussians
from nvsim.training.config import TrainingConfig

SUNK = 0.03
"""Metres below the floor from which a Gaussian is under it."""
APART = 0.5
"""The two halves are placed this many standard deviations to either side of the centre."""
SHRINK = 1.6
"""Their longest axis is shorter by this factor (Kerbl et al. 2023)."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """kept     (K,) indices of the Gaussians that stay as they are
    divided     (D,) indices of those that become two
    born        2 D new Gaussians
    """

    kept: NDArray[np.int64]
    divided: NDArray[np.int64]
    born: Gaussians

    @property
    def count(self) -> int:
        return len(self.kept) + len(self.born)


class Densifier:
    """The strategy: asked at every step whether it is time, and then what to do."""

    def __init__(self, config: TrainingConfig, floor: FloorSurface) -> None:
        self._config, self._floor = config, floor

    def is_due(self, step: int) -> bool:
        """Whether to refine after `step` (from 1)."""
        c = self._config
        return c.densify.enabled and step % c.densify.every == 0 and step <= c.densify.stop * c.steps

    def grows(self, step: int) -> bool:
        return step >= self._config.densify.start * self._config.steps

    def refine(self, gaussians: Gaussians, gradient: NDArray[np.float32], step: int) -> Refinement:
        """`gradient` (N,): mean over the views since the last refinement of the absolute screen gradient, times the
        number of pixels, because the losses are means."""
        c = self._config.densify
        lost = self.lost(gaussians)
        room = self._config.gaussian_cap - (len(gaussians) - int(lost.sum()))
        budget = min(room, int(c.growth * len(gaussians))) if self.grows(step) else 0
        wanting = np.flatnonzero((gradient > c.gradient) & ~lost)
        if budget <= 0:
            wanting = wanting[:0]
        elif len(wanting) > budget:
            order = np.argsort(-gradient[wanting], kind="stable")
            wanting = np.sort(wanting[order[:budget]])
        stays = ~lost
        stays[wanting] = False
        return Refinement(np.flatnonzero(stays), wanting, divide(gaussians, wanting))

    def lost(self, gaussians: Gaussians) -> NDArray[np.bool_]:
        """(N,) the Gaussians to remove: faint, vast, not finite, or under the floor."""
        c, g = self._config.densify, gaussians
        with np.errstate(over="ignore", invalid="ignore"):
            lost = ~(g.opacity_logits > np.log(c.prune_opacity / (1 - c.prune_opacity)))
            lost |= ~(g.log_scales.max(axis=1) < np.log(c.largest))
            lost |= ~np.isfinite(g.means).all(axis=1)
        if self._config.floor_aware:
            safe = np.where(lost[:, None], 0, g.means)
            lost |= safe[:, 2] < self._floor.height_at(safe[:, :2]) - SUNK
        return lost


def divide(gaussians: Gaussians, chosen: NDArray[np.int64]) -> Gaussians:
    """Two Gaussians for each of `chosen` (D,), first all the left halves, then all the right ones."""
    g = gaussians
    log_scales, quats = g.log_scales[chosen], g.quats[chosen]
    longest = log_scales.argmax(axis=1)
    rows = np.arange(len(chosen))
    axes = matrix_from_quaternion(quats)[rows, :, longest].reshape(-1, 3)
    offset = (axes * (APART * np.exp(log_scales[rows, longest]))[:, None]).astype(np.float32)
    log_scales = log_scales.copy()
    log_scales[rows, longest] -= np.float32(np.log(SHRINK))
    opacity = 1 / (1 + np.exp(-g.opacity_logits[chosen].astype(np.float64)))
    shared = np.clip(1 - np.sqrt(1 - opacity), 1e-4, 1 - 1e-4)
    logits = np.log(shared / (1 - shared)).astype(np.float32)

    def twice(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.concatenate([array, array])

    means = np.concatenate([g.means[chosen] - offset, g.means[chosen] + offset])
    return Gaussians(means, twice(log_scales), twice(quats), twice(logits), twice(g.sh[chosen]))
