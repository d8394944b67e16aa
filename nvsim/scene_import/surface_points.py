"""Points on the surfaces that Gaussians show, with the normals of the Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians

COUNT = 600_000
_FAINT = 0.1  # opacity below which a Gaussian shows no surface
_LARGEST = 0.05  # of the extent: greater standard deviations are sky or fog, not a surface
_FLAT = 0.6  # greatest ratio of the two smallest standard deviations of a Gaussian with a normal


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """points   (N, 3) float64, in the unit of the Gaussians, at most one per cell
    normals  (N, 3) float64 unit vectors of either sign; 0 for Gaussians that are not flat
    cell     side of the cells, in the unit of the Gaussians
    bright   (N,) float32 mean of red, green, and blue, 0 is black and 1 is white
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    cell: float
    bright: NDArray[np.float32]


def central_box(means: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners (3,) of the box that contains the means (N, 3) except 2 % at each side, with a margin of a quarter of
    its size."""
    low, high = np.percentile(means[:: max(1, len(means) // 200_000)].astype(np.float64), [2, 98], axis=0)
    margin = 0.25 * (high - low) + 1e-9
    return low - margin, high + margin


def surface_points(gaussians: Gaussians, cell: float, count: int = COUNT) -> SurfacePoints:
    """Points of opaque Gaussians, spread over the area of each and thinned to one per cell of side `cell`, which is in
    the unit of the Gaussians. Equal Gaussians give equal points."""
    g, random = gaussians, np.random.default_rng(0)
    low, high = central_box(g.means)
    scales = np.exp(g.log_scales.astype(np.float64))
    order = np.sort(scales, axis=1)
    used = (g.opacity_logits > np.log(_FAINT / (1 - _FAINT))) & (order[:, 2] < _LARGEST * float((high - low).max()))
    used &= ((g.means > low) & (g.means < high)).all(axis=1)
    rows = np.flatnonzero(used)
    if not len(rows):
        return SurfacePoints(np.zeros((0, 3)), np.zeros((0, 3)), cell, np.zeros(0, np.float32))
    area = order[rows, 2] * np.maximum(order[rows, 1], 0.1 * order[rows, 2]) + (0.3 * cell) ** 2
    ends = np.cumsum(area)
    steps = (np.arange(count) + random.random(count)) * (ends[-1] / count)
    rows = rows[np.minimum(np.searchsorted(ends, steps), len(rows) - 1)]
    axes = matrix_from_quaternion(g.quats[rows])
    offsets = np.clip(random.normal(size=(count, 3)), -2, 2) * scales[rows]
    points = g.means[rows].astype(np.float64) + np.einsum("nij,nj->ni", axes, offsets)
    thin = np.argmin(scales[rows], axis=1)
    normals = axes[np.arange(count), :, thin]
    normals[order[rows, 0] > _FLAT * order[rows, 1]] = 0.0
    keys = np.floor((points - low) / cell).astype(np.int64)
    first = np.sort(np.unique(keys @ np.array([1, 1 << 20, 1 << 40]), return_index=True)[1])
    bright = np.clip(0.5 + DC * g.sh[rows[first], 0].mean(axis=1), 0, 1)
    return SurfacePoints(points[first], normals[first], cell, bright.astype(np.float32))
