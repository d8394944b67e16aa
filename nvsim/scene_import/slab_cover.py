"""How much of the ground Gaussians cover in slabs of height above a floor, seen from above. No image is rendered."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.kernels import njit
from nvsim.splats.types import Gaussians

_FAINT = 0.02  # opacity of Gaussians that are skipped
_CHUNK = 1 << 18


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid over the ground: `low` (x, y) meters is the corner of cell [0, 0], and row follows y.

    spacing  meters per cell
    shape    (rows, columns)
    """

    low: tuple[float, float]
    spacing: float
    shape: tuple[int, int]

    def centers(self) -> NDArray[np.float64]:
        """(rows, columns, 2) world x, y of the middle of the cells, meters."""
        rows, columns = self.shape
        x = self.low[0] + (np.arange(columns) + 0.5) * self.spacing
        y = self.low[1] + (np.arange(rows) + 0.5) * self.spacing
        return np.stack(np.meshgrid(x, y), axis=-1)

    def cells_of(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N, 2) row and column of points (N, 2 or 3), also outside the grid."""
        found = np.floor((np.asarray(xy, np.float64)[:, :2] - self.low) / self.spacing).astype(np.int64)
        return found[:, ::-1]


def slab_cover(
    gaussians: Gaussians, grid: Grid, floor: NDArray[np.float64], slabs: list[tuple[float, float]]
) -> NDArray[np.float32]:
    """(slabs, rows, columns) share of each cell that Gaussians cover between two heights above the floor, 0 to 1.

    gaussians  z up, meters
    floor      (rows, columns) meters, world
    slabs      lower and upper height above the floor, meters

    A Gaussian covers its opacity times its share in the slab, spread as seen from above and widened by a cell. Several
    Gaussians cover a cell independently, as in alpha.
    """
    left = np.ones((len(slabs), *grid.shape), np.float32)
    limits = np.array(slabs, np.float64).reshape(-1, 2)
    for first in range(0, len(gaussians), _CHUNK):
        part = slice(first, first + _CHUNK)
        opacity = 1.0 / (1.0 + np.exp(-gaussians.opacity_logits[part].astype(np.float64)))
        used = opacity > _FAINT
        axes = matrix_from_quaternion(gaussians.quats[part][used]) * np.exp(gaussians.log_scales[part][used])[:, None]
        c = axes @ axes.transpose(0, 2, 1)
        rows = np.column_stack(
            [gaussians.means[part][used], opacity[used], c[:, 0, 0], c[:, 0, 1], c[:, 1, 1], c[:, 2, 2]]
        )
        _cover(rows.astype(np.float64), np.array(grid.low), grid.spacing, np.ascontiguousarray(floor), limits, left)
    return np.asarray(1.0 - left, np.float32)


@njit(cache=True, error_model="numpy")
def _cover(
    gaussians: NDArray[np.float64],  # (N, 8) x, y, z, opacity, and of the covariance xx, xy, yy, zz
    origin: NDArray[np.float64],  # (2,) meters
    spacing: float,
    floor: NDArray[np.float64],  # (rows, columns) meters
    limits: NDArray[np.float64],  # (slabs, 2) meters above the floor
    left: NDArray[np.float32],  # (slabs, rows, columns) in and out: the share that is not covered
) -> None:
    slabs, rows, columns = left.shape
    own = spacing * spacing / 12.0
    for g in range(len(gaussians)):
        xx, xy, yy = gaussians[g, 4] + own, gaussians[g, 5], gaussians[g, 6] + own
        det = xx * yy - xy * xy
        before = (xx - own) * (yy - own) - xy * xy
        if not det > 0.0:
            continue
        # A Gaussian narrower than a cell covers only a part of it.
        peak = gaussians[g, 3] * math.sqrt(max(before, 0.0) / det) if before < det else gaussians[g, 3]
        reach_x, reach_y = 2.6 * math.sqrt(xx), 2.6 * math.sqrt(yy)
        first_column = max(0, int(math.floor((gaussians[g, 0] - reach_x - origin[0]) / spacing)))
        last_column = min(columns - 1, int(math.floor((gaussians[g, 0] + reach_x - origin[0]) / spacing)))
        first_row = max(0, int(math.floor((gaussians[g, 1] - reach_y - origin[1]) / spacing)))
        last_row = min(rows - 1, int(math.floor((gaussians[g, 1] + reach_y - origin[1]) / spacing)))
        inverse_xx, inverse_xy, inverse_yy = yy / det, -xy / det, xx / det
        scale = 1.0 / math.sqrt(2.0 * max(gaussians[g, 7], 1e-8))
        for row in range(first_row, last_row + 1):
            dy = origin[1] + (row + 0.5) * spacing - gaussians[g, 1]
            for column in range(first_column, last_column + 1):
                dx = origin[0] + (column + 0.5) * spacing - gaussians[g, 0]
                power = 0.5 * (inverse_xx * dx * dx + 2 * inverse_xy * dx * dy + inverse_yy * dy * dy)
                if power > 3.4:
                    continue
                weight = peak * math.exp(-power)
                if weight < 0.01:
                    continue
                height = gaussians[g, 2] - floor[row, column]
                for slab in range(slabs):
                    share = 0.5 * (
                        math.erf((limits[slab, 1] - height) * scale) - math.erf((limits[slab, 0] - height) * scale)
                    )
                    if share > 0.01:
                        left[slab, row, column] *= 1.0 - weight * share
