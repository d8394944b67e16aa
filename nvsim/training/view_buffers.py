"""Buffers that the training views of one image size share, so that a step allocates none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.render.sh_polynomials import ROW
from nvsim.training.config import LossConfig
from nvsim.training.loss.floor_aware import FloorAwareLoss

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class ViewBuffers:
    """Buffers for one image size.

    background  (3, H, W) colors
    hits        (3, H, W) of `floor_rays.meet_floor`
    rows        (H, 9, 3) scratch of the background's gradient
    inlier      (H, W) bool, pixels that the robust mask keeps
    nowhere     (H, W) bool, an empty floor mask
    """

    loss: FloorAwareLoss
    background: Float32
    hits: Float32
    rows: Float32
    inlier: NDArray[np.bool_]
    nowhere: NDArray[np.bool_]

    @staticmethod
    def of(config: LossConfig, width: int, height: int) -> ViewBuffers:
        return ViewBuffers(
            FloorAwareLoss(config, width, height),
            np.zeros((3, height, width), np.float32),
            np.empty((3, height, width), np.float32),
            np.empty((height, ROW, 3), np.float32),
            np.ones((height, width), np.bool_),
            np.zeros((height, width), np.bool_),
        )
