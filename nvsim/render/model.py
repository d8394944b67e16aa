"""One submap model as an image: Gaussians, and the background where they let light through (paper section III-C)."""

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
    """rgb = Gaussians + (1 - alpha) * background, not clamped; alpha, depth and normal are of the Gaussians alone.
    Only `tiles` are drawn where they are given, as `render_gaussians` takes them.

    Safe to call from several threads. Raises ValueError for an unknown channel, InputError for a backend that
    cannot run here.
    """
    # Colours that depend on the position are overwritten by the next view's.
    lasting = model.appearance is None
    gaussians = model.gaussians_at(camera.position)
    output, transmittance = render_over(gaussians, camera, channels, model.antialiased, tiles, backend, lasting)
    if output.rgb is not None:
        if tiles is not None:
            k = camera.intrinsics
            transmittance = transmittance * pixels_of(tiles, k.height, k.width)
        paint_background(model, camera, transmittance, output.rgb)
    return output
