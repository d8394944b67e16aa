"""Steps of grey over the borders of the faces of a strip, beside steps between the pixels next to them: without seams
both are the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.scan_sampler import pixels_along
from nvsim.geometry.camera import look
from nvsim.geometry.skybox_faces import face_axes


def seam_steps(strip: NDArray[np.uint8]) -> tuple[float, float]:
    """Mean step of grey levels (mean of the three channels) over the 24 borders of a strip (S, 6 S, 3), and just beside
    them on both sides."""
    side = strip.shape[0]
    grey = strip.astype(np.float32).mean(axis=2)
    # The pixels inside a border, on it, and beyond it on the next face, by the rays through where they would be.
    inner, last, beyond, after = (grey[pixels_along(side, _rays(side, i))] for i in (-1.5, -0.5, 0.5, 1.5))
    beside = (np.abs(last - inner).mean() + np.abs(after - beyond).mean()) / 2
    return float(np.abs(beyond - last).mean()), float(beside)


def _rays(side: int, offset: float) -> NDArray[np.float64]:
    """(6, 4, S, 3) world directions `offset` pixels outside each border, along it, for a pose that faces +y."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    out = np.full(side, 1 + 2 * offset / side)
    if offset > 0:  # beyond the border the next face begins: its pixels lie at even steps there
        out, along = np.full(side, 1 / (1 - 2 * offset / side)), along / (1 - 2 * offset / side)
    edges = [(-out, along), (out, along), (along, -out), (along, out)]
    local = np.stack([np.stack([u, v, np.ones(side)], axis=-1) for u, v in edges])
    return np.asarray(local[None] @ (look(np.zeros(3), 0.0)[:3, :3] @ face_axes()).swapaxes(-1, -2)[:, None])
