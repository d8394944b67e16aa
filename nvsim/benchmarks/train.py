"""Measures the cost of a training step and of its parts, in a room that is generated in memory.

The baseline on a GPU is a plain step: gsplat rasterization, L1 and SSIM in torch, and Adam. It equals one view in
gsplat's own example trainer, without background, floor, masks and densification strategies.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.benchmarks.render_card import milliseconds, name_of
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.gsplat_backend import rasterize
from nvsim.splats.types import Gaussians
from nvsim.training.config import Device, preset
from nvsim.training.devices import choice
from nvsim.training.floor_paint import initial_floor_paint
from nvsim.training.model_fit import STEP_PARTS, ModelFit
from nvsim.training.synthetic import EYE_HEIGHT, ROOM, photograph, synthetic_gaussians
from nvsim.training.views import TrainingView

VIEWS = 24
SIMPLE_STEPS = 30
_RATES = {"means": 1.6e-4, "log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "sh": 2.5e-3}
_WIDTH, _SIGMA = 11, 1.5  # of the SSIM window, in pixels


def views_across_room(width: int, height: int) -> list[TrainingView]:
    """Views from positions near the walls across the room; each shows a third of it."""
    intrinsics, views = Intrinsics.from_fov(width, height, np.radians(70)), []
    for i, angle in enumerate(np.linspace(0, 2 * np.pi, VIEWS, endpoint=False)):
        outward = np.array([np.cos(angle), np.sin(angle)])
        place = ROOM[:2] * (0.5 + 0.43 * outward)
        heading = float(np.arctan2(*-outward)) + 0.2 * (-1) ** i
        views.append(
            photograph(f"{i:04d}", Camera(intrinsics, camera_pose(np.array([*place, EYE_HEIGHT]), heading, -0.1)))
        )
    return views


def measure(
    gaussians: int = 100_000,
    width: int = 640,
    height: int = 480,
    sh_degree: int = 3,
    steps: int = 48,
    warm_up: int = 24,
    seed: int = 0,
    device: Device = "cpu",
    preset_name: str = "nvsim",
) -> dict[str, Any]:
    """Medians over `steps` steps, each with another camera, after `warm_up` steps that also compile the kernels.

    step_ms             a complete step, milliseconds
    <part>_ms           its parts, see `fit.STEP_PARTS`
    forward_ms          project + sort + raster
    ratio               step / (forward + raster_backward): cost of training relative to rendering and its gradient
    intersections, visible, gaussians, width, height, sh_degree, threads, device
    card_memory_mib     peak memory of tensors on the GPU, only with a GPU
    simple_step_ms      the step of `measure_simple_step`, only with a GPU

    On a GPU, raster includes project and sort. The time of raster_backward ends when the work is submitted; the rest
    of it counts in the following parts. Raises InputError if the device is missing.
    """
    config = replace(preset(preset_name), gaussian_cap=gaussians, sh_degree=sh_degree, device=device)
    place = choice.gpu_name(device)
    if place == "cuda":
        torch.cuda.reset_peak_memory_stats()
    views, floor = views_across_room(width, height), FloorSurface.flat(0.0)
    torch_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        start = synthetic_gaussians(gaussians, sh_degree, seed)
        fit = ModelFit(start, *initial_floor_paint(views, floor, config, seed), floor, config)
        inlier = np.ones((height, width), np.bool_)
        laps: dict[str, list[float]] = {name: [] for name in ("step", *STEP_PARTS)}
        for step in range(1, warm_up + steps + 1):
            started = time.perf_counter()
            fit.differentiate(views[step % VIEWS], inlier, sh_degree)
            fit.move(step)
            if step > warm_up:
                laps["step"].append(1e3 * (time.perf_counter() - started))
                for name in STEP_PARTS:
                    laps[name].append(fit.parts.get(name, 0.0))
    finally:
        torch.set_num_threads(torch_threads)
    figures = {f"{name}_ms": statistics.median(values) for name, values in laps.items()}
    figures["forward_ms"] = figures["project_ms"] + figures["sort_ms"] + figures["raster_ms"]
    figures["ratio"] = figures["step_ms"] / (figures["forward_ms"] + figures["raster_backward_ms"])
    if place is not None:
        start = synthetic_gaussians(gaussians, sh_degree, seed)
        figures |= measure_simple_step(start, [v.camera for v in views], [v.image for v in views], place, SIMPLE_STEPS)
    if place == "cuda":
        figures["card_memory_mib"] = torch.cuda.max_memory_allocated() / (1 << 20)
    return {
        **{name: round(value, 3) for name, value in figures.items()},
        **fit.held.figures(),
        "preset": preset_name,
        "device": "cpu" if place is None else name_of(place),
        "gaussians": gaussians,
        "width": width,
        "height": height,
        "sh_degree": sh_degree,
        "threads": numba.get_num_threads(),
    }


def measure_simple_step(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    device: str,
    steps: int,
) -> dict[str, float]:
    """simple_step_ms: median time of a step over `gaussians`. The steps take turns through `cameras` and their `images`
    (H, W, 3) uint8 RGB."""
    given = {name: getattr(gaussians, name) for name in _RATES}
    tensors = {name: torch.tensor(a, device=device, requires_grad=True) for name, a in given.items()}
    groups = [{"params": [tensors[name]], "lr": rate} for name, rate in _RATES.items()]
    adam = torch.optim.Adam(groups, eps=1e-15, fused=device != "cpu")
    photos = [torch.tensor(image, device=device).float() / 255 for image in images]
    window = _window(device)
    turns = itertools.cycle(range(len(cameras)))

    def step() -> None:
        at = next(turns)
        drawn = rasterize(*(tensors[name] for name in _RATES), camera=cameras[at])
        loss = 0.8 * (drawn.rgb - photos[at]).abs().mean() + 0.2 * (1 - _ssim(drawn.rgb, photos[at], window))
        loss.backward()
        adam.step()
        adam.zero_grad(set_to_none=True)

    return {"simple_step_ms": milliseconds(step, device, steps)}


def _window(device: str) -> torch.Tensor:
    x = torch.arange(_WIDTH, device=device) - _WIDTH // 2
    line = torch.exp(-(x**2) / (2 * _SIGMA**2))
    line = line / line.sum()
    return (line[:, None] * line[None]).expand(3, 1, _WIDTH, _WIDTH).contiguous()


def _ssim(a: torch.Tensor, b: torch.Tensor, window: torch.Tensor) -> torch.Tensor:
    a, b = a.permute(2, 0, 1)[None], b.permute(2, 0, 1)[None]

    def blur(image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.conv2d(image, window, padding=_WIDTH // 2, groups=3)

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    both = blur(a * b) - mean_a * mean_b
    alike = (2 * mean_a * mean_b + 1e-4) * (2 * both + 9e-4)
    return (alike / ((mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4))).mean()
