"""One submap model as an image: Gaussians, and the background where they let light through (paper section III-C)."""

from __future__ import annotations

from nvsim.geometry.camera import Camera
from nvsim.render.background import paint_background
from nvsim.render.gaussians import render_over
from nvsim.render.types import RenderOutput
from nvsim.splats.types import SubmapModel


def render_model(
    model: SubmapModel, camera: Camera, channels: frozenset[str] = frozenset({"rgb", "alpha"})
) -> RenderOutput:
    """rgb = Gaussians + (1 - alpha) * background, not clamped; alpha, depth and normal are of the Gaussians alone.

    Safe to call from several threads. Raises ValueError for an unknown channel.
    """
    output, transmittance = render_over(model.gaussians_at(camera.position), camera, channels, model.antialiased)
    if output.rgb is not None:
        paint_background(model, camera, transmittance, output.rgb)
    return output
