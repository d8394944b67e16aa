"""Renders one submap model: Gaussians, and the background where they are transparent (paper section III-C)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend
from nvsim.render.background import paint_background
from nvsim.render.gaussians import render_over
from nvsim.render.types import RenderOutput
from nvsim.render.workspace import pixels_of
from nvsim.splats.types import SubmapModel


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
