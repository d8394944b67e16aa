"""Computes the color names of the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.colour_names import NAMELESS, lab_of, names_of
from nvsim.r2r.surroundings.layers import CELL, FLOOR, Layers

_BLUR = 0.5  # meters over which patterns are averaged


def floor_names(layers: Layers) -> NDArray[np.int64]:
    """Returns (rows, columns) indices of floor colors into COLOURS, NAMELESS for unseen or unnamed floor."""
    import cv2

    on = np.abs(layers.above) <= FLOOR + CELL / 2
    at = layers.voxels[on]
    lab = np.zeros((*layers.shape, 4), np.float32)
    for i, values in enumerate([*lab_of(layers.colours[on]).T, np.ones(len(at), np.float32)]):
        np.add.at(lab[..., i], (at[:, 1], at[:, 0]), values)
    side = round(_BLUR / CELL) | 1
    blurred = cv2.blur(lab, (side, side), borderType=cv2.BORDER_CONSTANT)
    seen = lab[..., 3] > 0
    mean = blurred[..., :3] / np.maximum(blurred[..., 3:], 1e-6)
    return np.where(seen, names_of(mean), NAMELESS)
