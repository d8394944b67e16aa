"""What a training step costs, and its parts, on a room made in memory."""

from __future__ import annotations

import statistics
import time

import numba
import numpy as np
import torch

from nvsim.training.config import TrainingConfig
from nvsim.training.fit import Fit
from nvsim.training.floor_paint import first_paint
from nvsim.training.initialise import initial_gaussians
from nvsim.training.strategies.config import DensifyConfig
from nvsim.training.synthetic import synthetic_room

PARTS = ("forward", "background", "loss", "backward", "background_backward", "optimizer")


def measure(
    gaussians: int = 60_000, width: int = 320, height: int = 240, steps: int = 40, warm_up: int = 60, seed: int = 0
) -> dict[str, float]:
    """Medians over `steps` steps after `warm_up` ones, which also compile the kernels.

    step_ms                a whole step, milliseconds
    <part>_ms              of it: forward and backward (rasteriser), background and background_backward, loss, optimizer
    gaussians, width, height, threads
    """
    config = TrainingConfig(
        gaussian_cap=gaussians,
        seed_share=1.0,
        seed_height=0.0,
        densify=DensifyConfig(strategy="none"),
        coarse_share=0.0,
    )
    room = synthetic_room(24, width, height, gaussians + gaussians // 8, seed)
    rng = np.random.default_rng(seed)
    torch_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        start = initial_gaussians(room.views, room.cloud, room.floor, config, rng)
        fit = Fit(start, *first_paint(room.views, room.floor, config, seed), room.floor, config)
        inlier = np.ones((height, width), np.bool_)
        laps: dict[str, list[float]] = {name: [] for name in ("step", *PARTS)}
        for step in range(1, warm_up + steps + 1):
            started = time.perf_counter()
            fit.differentiate(room.views[step % len(room.views)], inlier, config.sh_degree)
            fit.move(step)
            if step > warm_up:
                laps["step"].append(1e3 * (time.perf_counter() - started))
                for name in PARTS:
                    laps[name].append(fit.parts[name])
    finally:
        torch.set_num_threads(torch_threads)
    figures = {f"{name}_ms": round(statistics.median(values), 3) for name, values in laps.items()}
    return {
        **figures,
        "gaussians": len(start),
        "width": width,
        "height": height,
        "threads": numba.get_num_threads(),
    }
