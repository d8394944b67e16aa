"""Measure gray steps across the borders of a strip's faces, and steps between pixels next to them. Without seams, both
are equal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.scan_sampler import pixels_along
from nvsim.geometry.camera import look
from nvsim.geometry.skybox_faces import face_axes


def seam_steps(strip: NDArray[np.uint8]) -> tuple[float, float]:
    """Mean gray step (of the mean of three channels) across the 24 borders of a strip (S, 6 S, 3) uint8, and between
    pixels next to them on both sides."""
    side = strip.shape[0]
    grey = strip.astype(np.float32).mean(axis=2)
    # Pixels inside a border, at it, and beyond it on the next face, found by the rays through their positions.
    inner, last, beyond, after = (grey[pixels_along(side, _rays(side, i))] for i in (-1.5, -0.5, 0.5, 1.5))
    beside = (np.abs(last - inner).mean() + np.abs(after - beyond).mean()) / 2
    return float(np.abs(beyond - last).mean()), float(beside)


def _rays(side: int, offset: float) -> NDArray[np.float64]:
    """(6, 4, S, 3) world directions along each border, `offset` pixels outside it, for a pose that faces +y."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    out = np.full(side, 1 + 2 * offset / side)
    if offset > 0:  # outside the border is the next face, whose pixels are evenly spaced on its own plane
        out, along = np.full(side, 1 / (1 - 2 * offset / side)), along / (1 - 2 * offset / side)
    edges = [(-out, along), (out, along), (along, -out), (along, out)]
    local = np.stack([np.stack([u, v, np.ones(side)], axis=-1) for u, v in edges])
    return np.asarray(local[None] @ (look(np.zeros(3), 0.0)[:3, :3] @ face_axes()).swapaxes(-1, -2)[:, None])
