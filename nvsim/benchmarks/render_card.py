"""Measures gsplat rendering of many Gaussians on a GPU, and compares its images with those of the CPU kernels. Times
work on a GPU."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from nvsim.benchmarks.render import turn_camera_stepwise
from nvsim.geometry.camera import Camera
from nvsim.render import gsplat_backend
from nvsim.render.gsplat_backend import rasterize
from nvsim.render.model import render_gaussians
from nvsim.splats.types import Gaussians


def name_of(device: str) -> str:
    """The name of the GPU, or "cpu"."""
    return torch.cuda.get_device_name(device) if device != "cpu" else "cpu"


_WARM_UP = 3  # calls that are not counted


def settle(device: str) -> None:
    """Waits until the device has finished all submitted work."""
    if device != "cpu":
        torch.cuda.synchronize(device)


def milliseconds(work: Callable[[], object], device: str, rounds: int) -> float:
    """Median time of `work` over `rounds` calls in milliseconds, including its work on the GPU."""
    times = []
    for k in range(_WARM_UP + rounds):
        settle(device)
        started = time.perf_counter()
        work()
        settle(device)
        if k >= _WARM_UP:
            times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)


CHANNELS = frozenset({"rgb", "alpha", "depth", "normal"})
_FIELDS = ("means", "log_scales", "quats", "opacity_logits", "sh")


def measure(
    gaussians: Gaussians, camera: Camera, antialiased: bool = True, rounds: int = 15, device: str = "cuda"
) -> dict[str, Any]:
    """Medians over `rounds`, in milliseconds:

    upload_ms         copying the Gaussians to the GPU
    frame_ms, fps     a complete call for color and alpha with a turning camera, with the images as numpy arrays
    geometry_ms       as frame_ms, with depth and normals
    forward_ms        rasterization alone, without a copy to the CPU
    backward_ms       from the gradient of the images to that of the raw parameters
    psnr_db           PSNR of the colors relative to the CPU kernels; also alpha_psnr_db, depth_db and normal_db
    card_memory_mib   peak memory of tensors on the GPU
    """
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    g, k = gaussians, camera.intrinsics
    frames = iter(turn_camera_stepwise(camera, 2 * (rounds + 3)))

    def frame(channels: frozenset[str]) -> None:
        gsplat_backend.render_over(g, next(frames), channels, antialiased, lasting=True, device=device)

    ms = {"upload_ms": milliseconds(lambda: gsplat_backend.upload(g, device), device, rounds)}
    ms["frame_ms"] = milliseconds(lambda: frame(frozenset({"rgb", "alpha"})), device, rounds)
    ms["geometry_ms"] = milliseconds(lambda: frame(CHANNELS), device, rounds)
    tensors = [torch.tensor(getattr(g, name), device=device, requires_grad=True) for name in _FIELDS]
    towards = torch.randn(k.height, k.width, 3, device=device)

    def forward() -> None:
        with torch.no_grad():
            rasterize(*tensors, camera=camera, antialiased=antialiased)

    def render_and_backpropagate() -> None:
        rasterize(*tensors, camera=camera, antialiased=antialiased).rgb.backward(towards)
        for tensor in tensors:
            tensor.grad = None

    ms["forward_ms"] = milliseconds(forward, device, rounds)
    ms["backward_ms"] = milliseconds(render_and_backpropagate, device, rounds) - ms["forward_ms"]
    figures: dict[str, Any] = {name: round(value, 3) for name, value in ms.items()}
    figures["fps"] = round(1e3 / max(ms["frame_ms"], 1e-6), 1)
    figures |= agreement(g, camera, antialiased, device)
    if device == "cuda":
        figures["card_memory_mib"] = round(torch.cuda.max_memory_allocated() / (1 << 20), 1)
    return {
        **figures,
        "backend": "gsplat",
        "device": name_of(device),
        "gaussians": len(g),
        "sh_degree": g.sh_degree,
        "size": f"{k.width}x{k.height}",
        "antialiased": antialiased,
    }


def agreement(gaussians: Gaussians, camera: Camera, antialiased: bool, device: str) -> dict[str, float]:
    """PSNR in decibels between the images of gsplat and of the CPU kernels. The peak is the largest depth for depth and
    2 for normals."""
    ours = render_gaussians(gaussians, camera, CHANNELS, antialiased, backend="numba")
    theirs, _ = gsplat_backend.render_over(gaussians, camera, CHANNELS, antialiased, device=device)
    assert ours.depth is not None
    peaks = {"rgb": 1.0, "alpha": 1.0, "depth": float(ours.depth.max()) or 1.0, "normal": 2.0}
    names = {"rgb": "psnr_db", "alpha": "alpha_psnr_db", "depth": "depth_db", "normal": "normal_db"}
    found = {}
    for channel, peak in peaks.items():
        error = float(np.mean((getattr(ours, channel) - getattr(theirs, channel)) ** 2))
        found[names[channel]] = round(float(10 * np.log10(peak**2 / max(error, 1e-12))), 2)
    return found
