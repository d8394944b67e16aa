"""Gaussians alone as an image: the entry to the kernels for everything that needs no gradients."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.render.types import Float32, RenderOutput
from nvsim.render.workspace import LOCK, Workspace, ready
from nvsim.splats.types import Gaussians

ALPHA_OF_DEPTH = np.float32(1e-3)
"""Below this alpha a pixel has no depth."""

_workspace = Workspace()


def render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    antialiased: bool = True,
) -> RenderOutput:
    """The asked channels of "rgb", "alpha", "depth", "normal", as RenderOutput describes them, over black.

    Safe to call from several threads; one is served at a time, with every core. Raises ValueError for an unknown
    channel.
    """
    output, _ = render_over(gaussians, camera, channels, antialiased)
    return output


def render_over(
    gaussians: Gaussians, camera: Camera, channels: frozenset[str], antialiased: bool
) -> tuple[RenderOutput, Float32]:
    """As `render_gaussians`, with the transmittance (H, W) = 1 - alpha, what is left for a background."""
    unknown = channels - {"rgb", "alpha", "depth", "normal"}
    if unknown:
        raise ValueError(f"unknown render channels: {', '.join(sorted(unknown))}")
    g = gaussians
    arrays = Gaussians(*(ready(a) for a in (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)))
    k = camera.intrinsics
    geometry = bool(channels & {"depth", "normal"})
    with LOCK:
        _workspace.project(arrays, camera, antialiased)
        _workspace.bin()
        rgb, transmittance, depth, normal = _workspace.draw(k.height, k.width, geometry)
    output = RenderOutput()
    if "rgb" in channels:
        output.rgb = rgb
    if channels & {"alpha", "depth"}:
        alpha = 1 - transmittance
        if "alpha" in channels:
            output.alpha = alpha
        if "depth" in channels:
            output.depth = expected_depth(depth, alpha)
    if "normal" in channels:
        output.normal = normal
    return output, transmittance


def expected_depth(weighted: Float32, alpha: Float32) -> Float32:
    """Weighted sum of depths over alpha, 0 where alpha is below ALPHA_OF_DEPTH; all (H, W)."""
    mean = weighted / np.maximum(alpha, ALPHA_OF_DEPTH)
    return np.where(alpha < ALPHA_OF_DEPTH, np.float32(0), mean)
