"""The strategies that divide Gaussians with large absolute screen gradients, "adaptive" and "capped".

Sources: Kerbl et al. 2023; AbsGS, Ye et al. 2024; Splatfacto's rules; Mallick et al. 2024. Sizes are in meters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians, joined, select_gaussians
from nvsim.training.strategies.config import DensifyConfig
from nvsim.training.strategies.division import divide, find_removable, logit, split
from nvsim.training.strategies.types import Float32, GaussianModel, Refinement, mean_gradient


class Capped:
    """The capped strategy: divides the Gaussians that need it most, never beyond the cap. Without a `floor`, Gaussians
    under it are kept.

    A large sum of absolute screen gradients indicates that one Gaussian represents several (AbsGS). Those with the
    largest gradients are divided first (Mallick et al. 2024). A Gaussian is divided along its longest axis into two
    with an equal total transmittance. There is no opacity reset, because short runs cannot recover from one."""

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


class Adaptive:
    """The adaptive strategy: adaptive density control of 3D Gaussian splatting with absolute gradients. Without a
    `floor`, Gaussians under it are kept. `rng` places the parts of a split.

    If the mean absolute screen gradient is large, a small Gaussian is cloned and a large one is split. The opacity is
    reset at intervals, so that unneeded Gaussians fade and are culled. After a reset, growth pauses. If the cap limits
    growth, those with the largest gradients come first."""

    def __init__(
        self, config: DensifyConfig, steps: int, cap: int, floor: FloorSurface | None, rng: np.random.Generator
    ) -> None:
        self._config, self._steps, self._cap, self._floor, self._rng = config, steps, cap, floor, rng

    def before_update(self, model: GaussianModel, step: int) -> None:
        """Does nothing."""

    def after_update(self, model: GaussianModel, step: int) -> None:
        """Refines or resets if it is due. Culling continues after growth has stopped, as in Splatfacto."""
        if step % self._config.every == 0 and not self.is_paused(step):
            model.refine(self.refined(model.gaussians, model.sums, step))
        if self.is_reset_due(step):
            limit = logit(np.array([self._config.adaptive.reset_opacity]))
            logits = model.gaussians.opacity_logits
            np.minimum(logits, limit, out=logits)
            model.reset_moments("opacity_logits")

    def is_growing(self, step: int) -> bool:
        """Whether Gaussians are added in a refinement after `step`."""
        return self._config.start * self._steps <= step <= self._config.stop * self._steps

    def is_reset_due(self, step: int) -> bool:
        """Whether the opacity is reset after `step`: at multiples of the interval while the model grows."""
        interval = self._interval
        return interval > 0 and step % interval == 0 and step <= self._config.stop * self._steps

    def is_paused(self, step: int) -> bool:
        """Whether `step` is in the pause after a reset."""
        interval = self._interval
        if interval == 0 or step <= interval:
            return False
        last = min(step - 1, int(self._config.stop * self._steps)) // interval * interval
        return last > 0 and step - last <= self._config.adaptive.pause * self._steps

    @property
    def _interval(self) -> int:
        share = self._config.adaptive.reset
        return max(int(share * self._steps), 1) if share > 0 else 0

    def refined(self, gaussians: Gaussians, sums: Float32, step: int) -> Refinement:
        """The refinement after `step`; `sums` (N, 3) as in `GaussianModel`."""
        c, rules = self._config, self._config.adaptive
        lost = find_removable(gaussians, c.prune_opacity, c.largest, self._floor)
        on_screen = step <= rules.screen_stop * self._steps
        # As in Splatfacto, the screen size culls only after the first reset, when Gaussians had time to shrink.
        if on_screen and rules.screen_cull > 0 and step > self._interval > 0:
            lost |= sums[:, 2] > rules.screen_cull
        cloned = halved = np.zeros(0, np.int64)
        if self.is_growing(step):
            cloned, halved = self._chosen(gaussians, sums, lost, on_screen)
        stays = ~lost
        stays[halved] = False
        born = joined(select_gaussians(gaussians, cloned), split(gaussians, halved, self._rng))
        return Refinement(np.flatnonzero(stays), born, np.concatenate([cloned, halved, halved]))

    def _chosen(
        self, gaussians: Gaussians, sums: Float32, lost: NDArray[np.bool_], on_screen: bool
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The indices of the Gaussians to clone and to split; each adds one."""
        rules = self._config.adaptive
        gradient = mean_gradient(sums)
        small = gaussians.log_scales.max(axis=1) <= np.log(rules.small)
        wide = (sums[:, 2] > rules.screen_split) if on_screen and rules.screen_split > 0 else np.zeros_like(lost)
        wanting = np.flatnonzero(((gradient > rules.gradient) | wide) & ~lost)
        chosen = largest_gradients(wanting, gradient, self._cap - int((~lost).sum()))
        cloning = small[chosen] & ~wide[chosen]
        return chosen[cloning], chosen[~cloning]
