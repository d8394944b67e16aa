"""Gaussians alone as an image: the entry to the kernels for everything that needs no gradients."""

from __future__ import annotations

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend, chosen
from nvsim.render.types import Float32, RenderOutput, expected_depth
from nvsim.render.workspace import LOCK, Workspace, ready
from nvsim.splats.types import Gaussians

_workspace = Workspace()


def render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    antialiased: bool = True,
    backend: Backend = "auto",
) -> RenderOutput:
    """The asked channels of "rgb", "alpha", "depth", "normal", as RenderOutput describes them, over black.

    Safe to call from several threads; one is served at a time, with every core. Raises ValueError for an unknown
    channel, InputError for a backend that cannot run here.
    """
    output, _ = render_over(gaussians, camera, channels, antialiased, backend)
    return output


def render_over(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    backend: Backend = "auto",
    lasting: bool = False,
) -> tuple[RenderOutput, Float32]:
    """As `render_gaussians`, with the transmittance (H, W) = 1 - alpha, what is left for a background. `lasting` says
    that the arrays of `gaussians` never change, so that a card may keep them."""
    unknown = channels - {"rgb", "alpha", "depth", "normal"}
    if unknown:
        raise ValueError(f"unknown render channels: {', '.join(sorted(unknown))}")
    if chosen(backend) == "gsplat":
        from nvsim.render import gsplat_backend

        return gsplat_backend.render_over(gaussians, camera, channels, antialiased, lasting)
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
