"""Render a view from small patches, so that every ray is near an optical axis. Each patch has its own axis and twice
the resolution.

Gaussians are flattened along the optical axis and sorted by depth along it. The error of both grows with the angle of a
ray to the axis. In a patch of 80 pixels this angle is at most 8 degrees. This module shares only the rasterizer with
the export of scans, so it can test the export.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel

_PATCH = 80  # pixels
_FINER = 2


def straight_view(model: SubmapModel, camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) float32, the view of `camera`, not clamped. Raises InputError if no backend can run here."""
    k = camera.intrinsics
    rays = camera.scaled(_FINER * k.width, _FINER * k.height).rays()
    image = np.empty((k.height, k.width, 3), np.float32)
    for top in range(0, k.height, _PATCH):
        for left in range(0, k.width, _PATCH):
            part = rays[_FINER * top : _FINER * (top + _PATCH), _FINER * left : _FINER * (left + _PATCH)]
            patch = _along(model, camera, part)
            size = part.shape[1] // _FINER, part.shape[0] // _FINER
            image[top : top + _PATCH, left : left + _PATCH] = cv2.resize(patch, size, interpolation=cv2.INTER_AREA)
    return image


def _along(model: SubmapModel, camera: Camera, rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3) colors along `rays` (h, w, 3), from one render whose axis is their mean direction."""
    ahead = rays.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    ahead /= np.linalg.norm(ahead)
    down = np.cross(ahead, camera.rotation[:, 0])
    down /= np.linalg.norm(down)
    pose = camera.camera_to_world.copy()
    pose[:3, :3] = np.stack([np.cross(down, ahead), down, ahead], axis=1)
    local = rays @ pose[:3, :3]
    across = (local[..., :2] / local[..., 2:]).astype(np.float32)
    focal = _FINER * camera.intrinsics.fx
    side = 2 * math.ceil(focal * float(np.abs(across).max()) + 2)
    drawn = render_model(model, Camera(Intrinsics(side, side, focal, focal, side / 2, side / 2), pose)).rgb
    assert drawn is not None
    at = across * np.float32(focal) + np.float32(side / 2 - 0.5)
    return np.asarray(cv2.remap(drawn, at[..., 0], at[..., 1], cv2.INTER_LINEAR), np.float32)
