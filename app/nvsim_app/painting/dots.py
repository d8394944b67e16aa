"""The displayed points of a point cloud and their colors, computed when the cloud is read. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim_app.painting.value_colors import ramp

MOST = 60_000  # maximum number of displayed points, sampled evenly
_TURN = np.uint32(2654435761)


@dataclass(frozen=True, eq=False)
class Dots:
    """The displayed points of a cloud in random order, so that the first ones are a representative sample.

    points   (N, 3) float32 meters, world; N is at most MOST
    tones    (N,) uint32 colors 0xffRRGGBB
    """

    cloud: Cloud
    points: NDArray[np.float32]
    tones: NDArray[np.uint32]

    @staticmethod
    def of(cloud: Cloud) -> Dots:
        """Samples the points of `cloud`. If the cloud has no colors, the colors represent the height."""
        count = len(cloud.points)
        rows = np.arange(0, count, max(1, count // (8 * MOST)))
        # Regular steps would select whole scan lines, so the order is scattered.
        rows = rows[np.argsort(rows.astype(np.uint32) * _TURN, kind="stable")[:MOST]]
        points = cloud.points[rows]
        if cloud.colors is not None:
            rgb = cloud.colors[rows].astype(np.uint32)
        else:
            low, high = np.quantile(points[:, 2], (0.02, 0.98)) if len(points) else (0.0, 1.0)
            rgb = ramp((points[:, 2] - low) / max(high - low, 1e-3)).astype(np.uint32)
        tones = (0xFF << 24 | rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2]).astype(np.uint32)
        return Dots(cloud, points, tones)
