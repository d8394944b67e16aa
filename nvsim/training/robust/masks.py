"""Which pixels are transients: the masks that a configuration may name, and what training asks of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.training.config import TrainingConfig
from nvsim.training.robust.blocks import BlockMask
from nvsim.training.robust.quantile import QuantileMask

Float32 = NDArray[np.float32]
Judge = Callable[[Float32, Float32, Float32], None]
"""Called with colour of the Gaussians (H, W, 3), transmittance (H, W) and background (3, H, W) of a picture that was
just drawn."""


class RobustMask(Protocol):
    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> Judge | None:
        """Called before view number `view` is drawn in `step` (from 1): writes `inlier` (H, W), or returns the function
        that will once the image is drawn. `inlier` holds the usable pixels before, and no other will count."""
        ...

    def end(self, view: int, error: Float32) -> None:
        """Called after the step with `error` (3, H, W), drawn minus true colour."""
        ...

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that a step changes, by name."""
        ...

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `state`."""
        ...


class NoMask:
    """Every pixel counts."""

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> None:
        return None

    def end(self, view: int, error: Float32) -> None:
        return None

    def state(self) -> dict[str, NDArray[np.generic]]:
        return {}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        return None


def robust_mask(config: TrainingConfig, count: int, width: int, height: int) -> RobustMask:
    """For `count` views, the first of them of `width` x `height` pixels."""
    match config.robust.kind:
        case "blocks":
            return BlockMask(config.robust, config.steps, count, width, height)
        case "quantile":
            return QuantileMask(config.robust, config.steps)
        case "none":
            return NoMask()
