"""The robust masks that a configuration can select, and their interface to training."""

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
"""A function that gets the color of the Gaussians (H, W, 3), the transmittance (H, W), and the background (3, H, W) of
the view just drawn."""


class RobustMask(Protocol):
    """A mask of transients, updated in every step."""

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> Judge | None:
        """Called before view number `view` is drawn in `step` (from 1). Writes `inlier` (H, W), or returns a function
        that writes it after the image (H, W, 3) is drawn. Initially `inlier` contains the usable pixels; the others
        never count."""
        ...

    def end(self, view: int, error: Float32) -> None:
        """Called after the step with `error` (3, H, W), drawn minus true color."""
        ...

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All arrays that a step changes, by name, of any shape."""
        ...

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`, of any shape."""
        ...


class NoMask(RobustMask):
    """A robust mask that keeps every pixel."""

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> None:
        return None

    def end(self, view: int, error: Float32) -> None:
        return None

    def state(self) -> dict[str, NDArray[np.generic]]:
        return {}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        return None


def robust_mask(config: TrainingConfig, count: int, width: int, height: int) -> RobustMask:
    """The mask of a configuration for `count` views. The first one has `width` x `height` pixels."""
    match config.robust.kind:
        case "blocks":
            return BlockMask(config.robust, config.steps, count, width, height)
        case "quantile":
            return QuantileMask(config.robust, config.steps)
        case "none":
            return NoMask()
