"""The training views: an image, its camera, and its floor mask."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class TrainingView:
    """name    of the frame
    camera     its size is that of `image`
    image      (H, W, 3) uint8 RGB, undistorted
    floor      (H, W) bool, the floor mask M
    doubtful   (H, W) bool, possible floor outside the mask; None if there is no doubt
    usable     (H, W) bool, False for pixels that the capture's mask excludes, which have no loss; None without a mask
    """

    name: str
    camera: Camera
    image: NDArray[np.uint8]
    floor: NDArray[np.bool_]
    doubtful: NDArray[np.bool_] | None = None
    usable: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        k = self.camera.intrinsics
        if self.image.shape != (k.height, k.width, 3) or self.floor.shape != (k.height, k.width):
            raise ValueError(
                f"{self.name}: image {self.image.shape} and mask {self.floor.shape} do not fit {k.width}x{k.height}"
            )

    def at_half_size(self) -> TrainingView:
        """The view at half its size, resampled by area."""
        k = self.camera.intrinsics
        width, height = max(1, round(k.width / 2)), max(1, round(k.height / 2))
        image = np.asarray(cv2.resize(self.image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)

        def covers_most(mask: NDArray[np.bool_], most: float = 0.5) -> NDArray[np.bool_]:
            share = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            return np.asarray(share > most)

        doubtful = None if self.doubtful is None else covers_most(self.doubtful)
        usable = None if self.usable is None else covers_most(self.usable, 0.999)
        return TrainingView(
            self.name, self.camera.scaled(width, height), image, covers_most(self.floor), doubtful, usable
        )
