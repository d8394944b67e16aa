"""The steps of DDIM (Song et al. 2021, eq. 12 with eta 0), with the timesteps of diffusers' DDIMScheduler."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.networks.description import Scheduler


class Ddim:
    """timesteps  (steps,) int64, indices of training timesteps, noisiest first"""

    def __init__(self, scheduler: Scheduler) -> None:
        s = self._said = scheduler
        if s.betas == "linear":
            betas = np.linspace(s.first_beta, s.last_beta, s.trained)
        else:
            betas = np.linspace(s.first_beta**0.5, s.last_beta**0.5, s.trained) ** 2
        self._alphas = np.cumprod(1 - betas)
        self._stride = s.trained // s.steps
        if s.spacing == "leading":
            times = np.arange(s.steps)[::-1] * self._stride + s.offset
        else:
            times = np.round(np.arange(s.trained, 0, -s.trained / s.steps)) - 1
        self.timesteps = np.clip(times, 0, s.trained - 1).astype(np.int64)

    def step(self, state: NDArray[Any], prediction: NDArray[Any], timestep: int) -> NDArray[np.float32]:
        """`state` after one denoising step, float32; `prediction` is the output of the network at `timestep`.

        All arrays have the shape of `state`."""
        before = timestep - self._stride
        end = 1.0 if self._said.ends_at_one else self._alphas[0]
        alpha, next_alpha = self._alphas[timestep], self._alphas[before] if before >= 0 else end
        x, said = np.asarray(state, np.float64), np.asarray(prediction, np.float64)
        kept, noisy = alpha**0.5, (1 - alpha) ** 0.5
        if self._said.predicts == "epsilon":
            clean, noise = (x - noisy * said) / kept, said
        elif self._said.predicts == "sample":
            clean, noise = said, (x - kept * said) / noisy
        else:
            clean, noise = kept * x - noisy * said, kept * said + noisy * x
        return np.asarray(next_alpha**0.5 * clean + (1 - next_alpha) ** 0.5 * noise, np.float32)
