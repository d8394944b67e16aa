"""Strategy "mcmc": 3D Gaussian Splatting as Markov chain Monte Carlo (Kheradmand et al. 2024).

Training is treated as sampling. Noise moves the Gaussians, mostly those with a low opacity. Dead ones are relocated to
live ones, which are drawn by opacity. The N Gaussians that then share a place get the opacity and size that keep the
image unchanged (equation 9). No Gaussian is removed. Growth adds Gaussians in the way of relocation, up to the cap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.splats.types import Gaussians, joined, select_gaussians
from nvsim.training.strategies.config import DensifyConfig
from nvsim.training.strategies.division import find_removable, logit, opacities
from nvsim.training.strategies.types import GaussianModel, Refinement

GATE, STEEPNESS = 0.005, 100.0
"""Opacity at which the noise fades out, and the slope of that logistic curve."""
MOST = 51
"""Greatest number of Gaussians in one place that is distinguished."""
Float64 = NDArray[np.float64]


class Mcmc:
    """The MCMC strategy. `rate` and `rate_end` are the learning rate of the means at the first and the last step.
    Without a `floor`, Gaussians under it are not dead."""

    def __init__(
        self,
        config: DensifyConfig,
        steps: int,
        cap: int,
        floor: FloorSurface | None,
        rng: np.random.Generator,
        rate: float,
        rate_end: float,
    ) -> None:
        self._config, self._steps, self._cap, self._floor, self._rng = config, steps, cap, floor, rng
        self._rates = rate, rate_end

    def before_update(self, model: GaussianModel, step: int) -> None:
        """Adds the gradients of the mean opacity and the mean size."""
        c, g, d = self._config.mcmc, model.gaussians, model.gradients
        n = max(len(g), 1)
        if c.opacity > 0:
            opacity = 1 / (1 + np.exp(-g.opacity_logits))
            d.opacity_logits += np.float32(c.opacity / n) * opacity * (1 - opacity)
        if c.scale > 0:
            d.log_scales += np.float32(c.scale / (3 * n)) * np.exp(g.log_scales)

    def after_update(self, model: GaussianModel, step: int) -> None:
        """Relocates and adds Gaussians if it is due; then adds noise."""
        c = self._config
        if step % c.every == 0 and c.start * self._steps <= step <= c.stop * self._steps:
            model.refine(self.refined(model.gaussians))
        if c.mcmc.noise > 0:
            first, last = self._rates
            rate = first * (last / first) ** ((step - 1) / self._steps)
            model.gaussians.means[:] += self.noise(model.gaussians, c.mcmc.noise * rate)

    def refined(self, gaussians: Gaussians) -> Refinement:
        """The refinement that moves dead Gaussians to live ones and adds as many as growth and cap allow."""
        c = self._config
        dead = find_removable(gaussians, c.mcmc.dead, c.largest, self._floor)
        alive = np.flatnonzero(~dead)
        if len(alive) == 0:
            return Refinement(np.arange(len(gaussians)), select_gaussians(gaussians, alive), alive)
        total = max(min(self._cap, int((1 + c.mcmc.growth) * len(gaussians))), len(gaussians))
        opacity = opacities(gaussians)[alive]
        drawn = self._rng.choice(len(alive), total - len(alive), p=opacity / opacity.sum())
        copies = np.bincount(drawn, minlength=len(alive))
        shared = np.flatnonzero(copies)
        changed = select_gaussians(gaussians, alive[shared])
        new_opacity, shrink = relocate_opacities(opacity[shared], copies[shared] + 1)
        changed.opacity_logits = logit(np.clip(new_opacity, c.mcmc.dead, 1 - 1e-6))
        changed.log_scales += np.log(shrink).astype(np.float32)[:, None]
        repeated = np.repeat(np.arange(len(shared)), copies[shared])
        parents = alive[np.concatenate([shared, shared[repeated]])]
        return Refinement(alive[copies == 0], joined(changed, select_gaussians(changed, repeated)), parents)

    def noise(self, gaussians: Gaussians, factor: float) -> NDArray[np.float32]:
        """(N, 3) meters: normal noise times the covariance, `factor`, and a gate that closes as opacity grows."""
        g = gaussians
        opacity = opacities(g)
        gate = 1 / (1 + np.exp(STEEPNESS * np.clip(opacity - GATE, -1, 1)))
        drawn = self._rng.standard_normal((len(g), 3), np.float32)
        open_ = np.flatnonzero(gate > 1e-4)
        axes = matrix_from_quaternion(g.quats[open_]).reshape(-1, 3, 3)
        along = np.einsum("nji,nj->ni", axes, drawn[open_]) * np.exp(2 * g.log_scales[open_].astype(np.float64))
        moved = np.zeros((len(g), 3), np.float32)
        moved[open_] = factor * gate[open_, None] * np.einsum("nij,nj->ni", axes, along)
        return moved


def relocate_opacities(opacity: Float64, count: NDArray[np.integer]) -> tuple[Float64, Float64]:
    """The opacity (M,) of each of `count` (M,) Gaussians that together look like one of `opacity` (M,), and the factor
    (M,) of their standard deviations (equation 9).

    On a line through the middle, `count` Gaussians in one place cover 1 - (1 - o' exp(-x^2 / 2 s'^2))^count. At x = 0
    this must equal `opacity`, and its integral over x must equal that of the single Gaussian; the powers are expanded.
    """
    n = np.minimum(count, MOST)
    whole = np.clip(opacity, 0, 1 - 1e-6)
    each = 1 - (1 - whole) ** (1 / n)
    width = np.zeros_like(each)
    for k in range(1, int(n.max(initial=1)) + 1):
        width += (-1.0) ** (k + 1) * comb(n, k) * each**k / np.sqrt(k)
    return each, whole / np.maximum(width, 1e-12)
