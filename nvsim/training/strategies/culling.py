"""Finds the Gaussians that every strategy removes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians

SUNK = 0.03
"""Depth below the floor, in meters, at which a Gaussian counts as under it."""


def find_removable(
    gaussians: Gaussians, faintest: float, largest: float, floor: FloorSurface | None
) -> NDArray[np.bool_]:
    """(N,) bool: Gaussians with an opacity below `faintest`, wider than `largest` meters on an axis, not finite, or
    under the floor."""
    g = gaussians
    with np.errstate(over="ignore", invalid="ignore"):
        lost = ~(g.opacity_logits > np.log(faintest / (1 - faintest)))
        lost |= ~(g.log_scales.max(axis=1) < np.log(largest))
        lost |= ~np.isfinite(g.means).all(axis=1)
    if floor is not None:
        safe = np.where(lost[:, None], 0, g.means)
        lost |= safe[:, 2] < floor.height_at(safe[:, :2]) - SUNK
    return lost
