"""One submap model as an image: Gaussians, and the background where they let light through (paper section III-C)."""

from __future__ import annotations

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend
from nvsim.render.background import paint_background
from nvsim.render.gaussians import render_over
from nvsim.render.types import RenderOutput
from nvsim.splats.types import SubmapModel


def render_model(
    model: SubmapModel,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    backend: Backend = "auto",
) -> RenderOutput:
    """rgb = Gaussians + (1 - alpha) * background, not clamped; alpha, depth and normal are of the Gaussians alone.

    Safe to call from several threads. Raises ValueError for an unknown channel, InputError for a backend that
    cannot run here.
    """
    # Colours that depend on the position are overwritten by the next view's.
    lasting = model.appearance is None
    gaussians = model.gaussians_at(camera.position)
    output, transmittance = render_over(gaussians, camera, channels, model.antialiased, backend, lasting)
    if output.rgb is not None:
        paint_background(model, camera, transmittance, output.rgb)
    return output
