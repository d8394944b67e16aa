"""How much of a corridor Gaussians cover between the floor and the camera: the slice of a model, seen from above.

NavGSim (arXiv:2603.15186) derives the navigable area from such a slice. Here, a Gaussian counts with its opacity, the
share of its height that is in the slice, and the share of the cell that it covers. No image is rendered.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.kernels import njit
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor, HeightAt, offset_ahead
from nvsim.render.nearby import along_a_curve
from nvsim.splats.types import Gaussians

ABOVE_FLOOR = 0.1
"""Meters above the floor; parts below this are no obstacle."""
_SPREAD = 1.0 / 12.0  # variance of a position in a cell, in cells squared
_FAINT = 1.0 / 255.0
_REACH = math.sqrt(2 * math.log(255))  # standard deviations at which 1 has fallen to 1/255
_TAIL = 7.0  # standard deviations beyond which the share of a Gaussian in the slice is zero
_GROUP = 64  # neighboring Gaussians that are skipped together
_WIDE = 1.0  # meters; Gaussians with a larger radius have their own groups, because they extend far


class SliceGaussians:
    """The Gaussians of one submap model, prepared for sums over corridors."""

    def __init__(self, gaussians: Gaussians) -> None:
        opacity = 1.0 / (1.0 + np.exp(-gaussians.opacity_logits.astype(np.float64)))
        used = opacity > _FAINT
        axes = matrix_from_quaternion(gaussians.quats[used]) * np.exp(gaussians.log_scales[used])[:, None, :]
        covariance = axes @ axes.transpose(0, 2, 1)
        upper = [covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        rows = np.column_stack([gaussians.means[used], opacity[used], *upper]).astype(np.float64)
        # At least the greatest standard deviation as seen from above.
        radius = _REACH * np.sqrt(upper[0] + upper[2])
        order = np.lexsort((along_a_curve(gaussians.means[used]), radius > _WIDE))
        self._rows, self._radius = rows[order], radius[order]
        starts = np.arange(0, len(order), _GROUP)
        reach, middle = self._radius[:, None], self._rows[:, :2]
        low, high = np.zeros((2, 0, 2))
        if len(order):
            low, high = np.minimum.reduceat(middle - reach, starts), np.maximum.reduceat(middle + reach, starts)
        self._boxes = np.concatenate([low, high], axis=1)

    def mass(self, corridor: Corridor, floor_at: HeightAt, top: float) -> NDArray[np.uint8]:
        """Return (rows, CELLS) uint8: the share of each cell that Gaussians cover between ABOVE_FLOOR and `top` meters
        above its floor, seen from above, * 255.

        A Gaussian of covariance S covers opacity * share * sqrt(det A / det B) * exp(-d' B^-1 d / 2) of a cell whose
        center is d away. A is S as seen from above. B is A widened by the variance of a position in the cell. `share`
        is the part of the Gaussian in the slice above the center of the cell. Several Gaussians cover a cell
        independently, as in alpha.
        """
        floor = np.ascontiguousarray(corridor.ground(floor_at)[..., 2])
        left = np.ones((corridor.rows, CELLS))
        start, forward = np.array(corridor.start), offset_ahead(corridor.heading, 1.0)
        slab = ABOVE_FLOOR, max(top, ABOVE_FLOOR)
        _cover(self._rows, self._radius, self._boxes, _GROUP, start, forward, floor, *slab, left)
        return np.round((1.0 - left) * 255).astype(np.uint8)


@njit(cache=True, error_model="numpy")
def _cover(
    gaussians: NDArray[np.float64],  # (N, 10) x, y, z, opacity, and of the covariance xx, xy, yy, xz, yz, zz
    radius: NDArray[np.float64],  # (N,) meters
    boxes: NDArray[np.float64],  # (groups, 4) meters: least x and y, greatest x and y of the Gaussians of each group
    size: int,  # Gaussians per group
    start: NDArray[np.float64],  # (2,) meters, world
    forward: NDArray[np.float64],  # (2,) unit
    floor: NDArray[np.float64],  # (rows, cells) meters, world
    low: float,  # meters above the floor
    high: float,
    left: NDArray[np.float64],  # (rows, cells) in and out: how much of each cell is not covered
) -> None:
    rows, cells = left.shape
    wide = WIDTH / cells
    sx, cx = forward[0], forward[1]
    length = NEAR + rows * DEPTH
    bottom, top = floor.min() + low, floor.max() + high
    for group in range(len(boxes)):
        # The box along the corridor and across it.
        x, y = (boxes[group, 0] + boxes[group, 2]) / 2 - start[0], (boxes[group, 1] + boxes[group, 3]) / 2 - start[1]
        half_x, half_y = (boxes[group, 2] - boxes[group, 0]) / 2, (boxes[group, 3] - boxes[group, 1]) / 2
        deep, broad = abs(sx) * half_x + abs(cx) * half_y + DEPTH, abs(cx) * half_x + abs(sx) * half_y + DEPTH
        if sx * x + cx * y < NEAR - deep or sx * x + cx * y > length + deep or abs(cx * x - sx * y) > WIDTH / 2 + broad:
            continue
        for g in range(group * size, min((group + 1) * size, len(gaussians))):
            x, y = gaussians[g, 0] - start[0], gaussians[g, 1] - start[1]
            along, across = sx * x + cx * y, cx * x - sx * y
            reach = radius[g] + DEPTH
            if along < NEAR - reach or along > length + reach or abs(across) > WIDTH / 2 + reach:
                continue
            z, opacity = gaussians[g, 2], gaussians[g, 3]
            xx, xy, yy = gaussians[g, 4], gaussians[g, 5], gaussians[g, 6]
            xz, yz, zz = gaussians[g, 7], gaussians[g, 8], gaussians[g, 9]
            # The covariance in the directions of the corridor, widened to the cell.
            a = sx * sx * xx + 2 * sx * cx * xy + cx * cx * yy
            b = sx * cx * (xx - yy) + (cx * cx - sx * sx) * xy
            c = cx * cx * xx - 2 * sx * cx * xy + sx * sx * yy
            az, cz = sx * xz + cx * yz, cx * xz - sx * yz
            before = max(a * c - b * b, 0.0)
            a += _SPREAD * DEPTH * DEPTH
            c += _SPREAD * wide * wide
            after = a * c - b * b
            weight = opacity * math.sqrt(before / after)
            if weight < _FAINT:
                continue
            ia, ib, ic = c / after, -b / after, a / after
            slope_a, slope_c = az * ia + cz * ib, az * ib + cz * ic
            spread = math.sqrt(max(zz - slope_a * az - slope_c * cz, 1e-12))
            out = math.sqrt(2 * math.log(weight / _FAINT))
            upright = out * (abs(slope_a) * math.sqrt(a) + abs(slope_c) * math.sqrt(c)) + _TAIL * spread
            if z + upright < bottom or z - upright > top:
                continue
            first = max(0, math.ceil((along - out * math.sqrt(a) - NEAR) / DEPTH - 0.5))
            last = min(rows - 1, math.floor((along + out * math.sqrt(a) - NEAR) / DEPTH - 0.5))
            near = max(0, math.ceil((across - out * math.sqrt(c) + WIDTH / 2) / wide - 0.5))
            far = min(cells - 1, math.floor((across + out * math.sqrt(c) + WIDTH / 2) / wide - 0.5))
            for row in range(first, last + 1):
                da = NEAR + (row + 0.5) * DEPTH - along
                for cell in range(near, far + 1):
                    dc = (cell + 0.5) * wide - WIDTH / 2 - across
                    power = 0.5 * (ia * da * da + 2 * ib * da * dc + ic * dc * dc)
                    middle = z + slope_a * da + slope_c * dc - floor[row, cell]
                    scale = 1.0 / (spread * math.sqrt(2.0))
                    share = 0.5 * (math.erf((high - middle) * scale) - math.erf((low - middle) * scale))
                    left[row, cell] *= 1.0 - weight * math.exp(-power) * share
