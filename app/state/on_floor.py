"""The height of the floor anywhere, and the trajectory lowered onto it, as graph and frames know them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.state.document import Document


def floor_height(
    document: Document, x: float, y: float, *, below: float | None = None, near: float | None = None
) -> float:
    """World z of the floor at x, y, as the nearest viewpoint or frame knows it.

    below   only floors under this height count, as long as there are any: the storey the eye is in
    near    floors that differ much from this height are far away: the same storey
    """
    feet = document.shown_arrays.feet
    if not len(feet):
        feet = trajectory_on_floor(document)
    if not len(feet):
        return 0.0
    distance = np.hypot(feet[:, 0] - x, feet[:, 1] - y)
    if below is not None and (feet[:, 2] < below).any():
        # Of the floors beneath the eye the nearest one, looked for around it.
        distance = distance + 3.0 * np.maximum(0.0, below - feet[:, 2]) + np.where(feet[:, 2] < below, 0.0, 1e6)
    if near is not None:
        distance = distance + 3.0 * np.abs(feet[:, 2] - near)
    return float(feet[np.argmin(distance), 2])


def trajectory_on_floor(document: Document) -> NDArray[np.float64]:
    """(N, 3) the frames' places, lowered to the floor by the height that the graph's viewpoints have; without a graph
    by the camera height that the capture was imported with, or else by 1.5 m."""
    positions = document.trajectory.positions
    if not len(positions):
        return positions
    arrays = document.graph_arrays
    height = document.contents.camera_height or 1.5
    if arrays.ids:
        height = float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2]))
    return positions - [0.0, 0.0, height]
