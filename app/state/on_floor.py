"""The height of the floor at any position, and the trajectory projected to the floor, from graph and frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.state.document import Document


def floor_height(
    document: Document, x: float, y: float, *, below: float | None = None, near: float | None = None
) -> float:
    """World z in meters of the floor at x, y, from the nearest viewpoint or frame; 0 if there is none.

    below   prefers floors below this height, to select the storey of the camera
    near    prefers floors near this height, to stay on one storey
    """
    feet = document.shown_arrays.feet
    if not len(feet):
        feet = trajectory_on_floor(document)
    if not len(feet):
        return 0.0
    distance = np.hypot(feet[:, 0] - x, feet[:, 1] - y)
    if below is not None and (feet[:, 2] < below).any():
        # Select a floor below the camera that is near in height and position.
        distance = distance + 3.0 * np.maximum(0.0, below - feet[:, 2]) + np.where(feet[:, 2] < below, 0.0, 1e6)
    if near is not None:
        distance = distance + 3.0 * np.abs(feet[:, 2] - near)
    return float(feet[np.argmin(distance), 2])


def trajectory_on_floor(document: Document) -> NDArray[np.float64]:
    """(N, 3) positions of the frames projected to the floor, meters, world. The camera height is the median height of
    the graph's viewpoints; without a graph, the height given at import, or else 1.5 m."""
    positions = document.trajectory.positions
    if not len(positions):
        return positions
    arrays = document.graph_arrays
    height = document.contents.camera_height or 1.5
    if arrays.ids:
        height = float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2]))
    return positions - [0.0, 0.0, height]
