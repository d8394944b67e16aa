"""A plain training step on a GPU as a baseline: gsplat rasterization, L1 and SSIM in torch, and Adam. It equals one
view in gsplat's own example trainer, without background, floor, masks and densification strategies."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.benchmarks.card import milliseconds
from nvsim.geometry.camera import Camera
from nvsim.render.gsplat_backend import rasterize
from nvsim.splats.types import Gaussians

STEPS = 30
RATES = {"means": 1.6e-4, "log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "sh": 2.5e-3}
_WIDTH, _SIGMA = 11, 1.5  # of the SSIM window, in pixels


def measure(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    device: str,
    steps: int = STEPS,
) -> dict[str, float]:
    """simple_step_ms: median time of a step over `gaussians`. The steps take turns through `cameras` and their `images`
    (H, W, 3) uint8 RGB."""
    given = {name: getattr(gaussians, name) for name in RATES}
    tensors = {name: torch.tensor(a, device=device, requires_grad=True) for name, a in given.items()}
    groups = [{"params": [tensors[name]], "lr": rate} for name, rate in RATES.items()]
    adam = torch.optim.Adam(groups, eps=1e-15, fused=device != "cpu")
    photos = [torch.tensor(image, device=device).float() / 255 for image in images]
    window = _window(device)
    turns = itertools.cycle(range(len(cameras)))

    def step() -> None:
        at = next(turns)
        drawn = rasterize(*(tensors[name] for name in RATES), camera=cameras[at])
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

    def blurred(image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.conv2d(image, window, padding=_WIDTH // 2, groups=3)

    mean_a, mean_b = blurred(a), blurred(b)
    var_a, var_b = blurred(a * a) - mean_a**2, blurred(b * b) - mean_b**2
    both = blurred(a * b) - mean_a * mean_b
    alike = (2 * mean_a * mean_b + 1e-4) * (2 * both + 9e-4)
    return (alike / ((mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4))).mean()
