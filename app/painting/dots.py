"""The points of a cloud that are drawn, and their tones: worked out where the cloud is read. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.painting.tones import ramp
from nvsim.capture.types import Cloud

MOST = 60_000  # points drawn; evenly taken from all
_TURN = np.uint32(2654435761)


@dataclass(frozen=True, eq=False)
class Dots:
    """points (N, 3) metres, world, at most MOST, the first few of which stand for all; tones (N,) 0xffRRGGBB."""

    cloud: Cloud
    points: NDArray[np.float32]
    tones: NDArray[np.uint32]

    @staticmethod
    def of(cloud: Cloud) -> Dots:
        """Without colours the height makes the tones."""
        count = len(cloud.points)
        rows = np.arange(0, count, max(1, count // (8 * MOST)))
        # Steps alone would take whole scan lines; in a scattered order the first few stand for all.
        rows = rows[np.argsort(rows.astype(np.uint32) * _TURN, kind="stable")[:MOST]]
        points = cloud.points[rows]
        if cloud.colors is not None:
            rgb = cloud.colors[rows].astype(np.uint32)
        else:
            low, high = np.quantile(points[:, 2], (0.02, 0.98)) if len(points) else (0.0, 1.0)
            rgb = ramp((points[:, 2] - low) / max(high - low, 1e-3)).astype(np.uint32)
        tones = (0xFF << 24 | rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2]).astype(np.uint32)
        return Dots(cloud, points, tones)
