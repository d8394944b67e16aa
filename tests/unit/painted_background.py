"""The background of a model alone."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.render.model import paint_background
from nvsim.splats.types import SubmapModel


def render_background(model: SubmapModel, camera: Camera) -> np.ndarray:
    """(H, W, 3) float32, not clamped: the background of the model without Gaussians; zeros if it has neither background
    nor texture."""
    k = camera.intrinsics
    rgb = np.zeros((k.height, k.width, 3), np.float32)
    paint_background(model, camera, np.ones((k.height, k.width), np.float32), rgb)
    return rgb
