"""Makes two Gaussians from one: divided along an axis, split at random, or cloned. Finds the Gaussians that every
strategy removes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.splats.types import Gaussians, joined, select_gaussians

APART = 0.5
"""Distance of the halves of `divide` from the center, in standard deviations."""
SHRINK = 1.6
"""Factor by which parts are smaller (Kerbl et al. 2023)."""
Indices = NDArray[np.int64]


def logit(opacity: NDArray[np.floating]) -> NDArray[np.float32]:
    """The inverse of the sigmoid, for `opacity` (N,) between 0 and 1."""
    return np.log(opacity / (1 - opacity)).astype(np.float32)


def opacities(gaussians: Gaussians) -> NDArray[np.float64]:
    """(N,) opacities, 0 to 1."""
    with np.errstate(over="ignore"):
        return np.asarray(1 / (1 + np.exp(-gaussians.opacity_logits.astype(np.float64))))


def divide(gaussians: Gaussians, chosen: Indices) -> Gaussians:
    """Two halves (2 D) of each of `chosen` (D,) along its longest axis, with an equal total transmittance. All left
    halves come first, then all right ones."""
    half = select_gaussians(gaussians, chosen)
    longest, rows = half.log_scales.argmax(axis=1), np.arange(len(chosen))
    axes = matrix_from_quaternion(half.quats)[rows, :, longest].reshape(-1, 3)
    offset = (axes * (APART * np.exp(half.log_scales[rows, longest]))[:, None]).astype(np.float32)
    half.log_scales[rows, longest] -= np.float32(np.log(SHRINK))
    half.opacity_logits = logit(np.clip(1 - np.sqrt(1 - opacities(half)), 1e-4, 1 - 1e-4))
    both = joined(half, half)
    both.means += np.concatenate([-offset, offset])
    return both


def split(gaussians: Gaussians, chosen: Indices, rng: np.random.Generator) -> Gaussians:
    """Two parts (2 D) of each of `chosen` (D,) at random points of it, smaller on every axis, with its opacity (Kerbl
    et al. 2023)."""
    part = select_gaussians(gaussians, chosen)
    both = joined(part, part)
    drawn = rng.standard_normal((len(both), 3)) * np.exp(both.log_scales)
    turned = np.einsum("nij,nj->ni", matrix_from_quaternion(both.quats).reshape(-1, 3, 3), drawn)
    both.means += turned.astype(np.float32)
    both.log_scales -= np.float32(np.log(SHRINK))
    return both


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
