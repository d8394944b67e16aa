"""Renders one submap model: Gaussians, and the background where they are transparent (paper section III-C)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend, Float32, RenderOutput, expected_depth, resolve_backend
from nvsim.render.background import paint_background
from nvsim.render.workspace import LOCK, RenderBuffers, as_kernel_array, pixels_of
from nvsim.splats.types import Gaussians, SubmapModel

_workspace = RenderBuffers()


def render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    antialiased: bool = True,
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
) -> RenderOutput:
    """Renders the requested channels "rgb", "alpha", "depth", "normal", as in RenderOutput, over black.

    `tiles` (lines, columns) bool, one per 16x16 pixels (see workspace.tiles_of), selects the tiles to draw; the others
    are zero.

    Safe to call from several threads; calls run one after the other, each with all cores. Raises ValueError for an
    unknown channel, InputError for a backend that cannot run here.
    """
    output, _ = render_over(gaussians, camera, channels, antialiased, tiles, backend)
    return output


def render_over(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
    lasting: bool = False,
    workspace: RenderBuffers | None = None,
) -> tuple[RenderOutput, Float32]:
    """As `render_gaussians`, and also the transmittance (H, W) = 1 - alpha for a background.

    lasting    the arrays of `gaussians` never change, so that a GPU can keep them
    workspace  buffers that no other thread uses meanwhile; without it the shared ones are used, under their lock
    """
    unknown = channels - {"rgb", "alpha", "depth", "normal"}
    if unknown:
        raise ValueError(f"unknown render channels: {', '.join(sorted(unknown))}")
    if resolve_backend(backend) == "gsplat":
        from nvsim.render import gsplat_backend

        whole, left = gsplat_backend.render_over(gaussians, camera, channels, antialiased, lasting)
        return (whole, left) if tiles is None else _clear_other_tiles(whole, left, tiles)
    if workspace is not None:
        return _render_gaussians(gaussians, camera, channels, antialiased, tiles, workspace)
    with LOCK:
        return _render_gaussians(gaussians, camera, channels, antialiased, tiles, _workspace)


def _render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    tiles: NDArray[np.bool_] | None,
    workspace: RenderBuffers,
) -> tuple[RenderOutput, Float32]:
    g, k = gaussians, camera.intrinsics
    arrays = Gaussians(*(as_kernel_array(a) for a in (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)))
    workspace.project(arrays, camera, antialiased, tiles=tiles)
    workspace.bin()
    rgb, transmittance, depth, normal = workspace.draw(k.height, k.width, bool(channels & {"depth", "normal"}))
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


def _clear_other_tiles(
    output: RenderOutput, transmittance: Float32, tiles: NDArray[np.bool_]
) -> tuple[RenderOutput, Float32]:
    # For a backend that can only render whole views.
    inside = pixels_of(tiles, *transmittance.shape)
    for channel in (output.rgb, output.alpha, output.depth, output.normal):
        if channel is not None:
            channel[~inside] = 0
    return output, np.where(inside, transmittance, np.float32(1))


def render_model(
    model: SubmapModel,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
) -> RenderOutput:
    """Renders a view. rgb = Gaussians + (1 - alpha) * background, (H, W, 3), not clamped. Alpha (H, W), depth (H, W),
    and normal (H, W, 3) are of the Gaussians alone. Only the given `tiles` are drawn, see `render_gaussians`.

    Safe to call from several threads. Raises ValueError for an unknown channel, InputError for a backend that
    cannot run here.
    """
    # Colors that depend on the position are overwritten by the next view.
    lasting = model.appearance is None
    gaussians = model.gaussians_at(camera.position)
    output, transmittance = render_over(gaussians, camera, channels, model.antialiased, tiles, backend, lasting)
    if output.rgb is not None:
        if tiles is not None:
            k = camera.intrinsics
            transmittance = transmittance * pixels_of(tiles, k.height, k.width)
        paint_background(model, camera, transmittance, output.rgb)
    return output
