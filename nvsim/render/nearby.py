"""Finds the Gaussians that can touch a few tiles of a view without testing each one: groups of neighbors are excluded
together. The result is a superset of the Gaussians that the kernels use, so the image is bit-identical.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit
from nvsim.render.by_rays import WIDE
from nvsim.render.kernel_types import Float32, Int32, Int64, Mask, limit, pack
from nvsim.render.workspace import as_kernel_array
from nvsim.splats.types import Gaussians

Float64 = NDArray[np.float64]
_RUN = 32  # Gaussians that are excluded together
_CELL, _CELLS = 0.5, 1024  # meters, and number of the cells by which neighbors are found
_WIDE = np.log(0.3)  # log meters; Gaussians with a larger scale get their own groups, because they extend far
_WIDEST = 30 * np.log(2)  # bound on the logarithm of a scale, as in the kernels
_REACH = math.sqrt(2 * math.log(255))  # standard deviations, as in the kernels
_GRACE = 1.0  # pixels of margin for rounding in single precision


class NeighborGroups:
    """The groups of neighboring Gaussians of one set, valid as long as the Gaussians do not move."""

    def __init__(self, gaussians: Gaussians) -> None:
        means = gaussians.means
        whole = np.flatnonzero(np.isfinite(means).all(axis=1))  # the kernels skip the others
        scale = np.nan_to_num(gaussians.log_scales[whole].max(axis=1), nan=_WIDEST).clip(-_WIDEST, _WIDEST)
        order = np.lexsort((along_a_curve(means[whole]), scale > _WIDE))
        starts = np.arange(0, len(order), _RUN)
        self._runs = np.full((len(starts), _RUN), -1, np.int32)
        self._runs.reshape(-1)[: len(order)] = whole[order]
        placed, empty = means[whole[order]].astype(np.float64), np.zeros((0, 3))
        low, high = ((a.reduceat(placed, starts) if len(order) else empty) for a in (np.minimum, np.maximum))
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        widest = np.maximum.reduceat(scale[order], starts) if len(order) else np.zeros(0)
        self._scale = np.exp(widest.astype(np.float64))
        self._count = len(means)

    def rows(self, camera: Camera, tiles: Mask) -> Int64:
        """(n,) rows, ascending, of the Gaussians that `tiles` (lines, columns) of the camera's image can show."""
        view = pack(camera, True)
        limit(view, tiles)
        marked = np.zeros(self._count, np.bool_)
        _select(
            self._middle, self._half, self._scale, self._runs, camera.world_to_camera, view.astype(np.float64), marked
        )
        return np.flatnonzero(marked)


@njit(cache=True, nogil=True, error_model="numpy")
def _select(
    middle: Float64,  # (runs, 3) meters, world, as half: the box around the Gaussians' centers
    half: Float64,  # (runs, 3)
    scale: Float64,  # (runs,) meters, the largest standard deviation
    runs: Int32,  # (runs, _RUN) rows of the Gaussians, -1 for unused entries
    pose: Float64,  # (4, 4) world to camera
    view: Float64,  # (33,) the camera, see `kernel_types.pack` and `limit`
    marked: Mask,  # (N,) out: True for the Gaussians of the groups that are not excluded; the rest is unchanged
) -> None:
    fx, fy, cx, cy = view[12], view[13], view[14] - 0.5, view[15] - 0.5
    filtered, nearest = view[25], view[27]
    longest = max(fx, fy) * view[28]
    for run in range(len(runs)):
        z, deep = pose[2, 3], 0.0
        for k in range(3):
            z += pose[2, k] * middle[run, k]
            deep += abs(pose[2, k]) * half[run, k]
        far = z + deep
        if not far > nearest:
            continue
        near = max(z - deep, nearest)
        stretch = scale[run] / near * longest
        most = _REACH * math.sqrt(stretch * stretch + filtered) + _GRACE
        x, y, wide, high = pose[0, 3], pose[1, 3], 0.0, 0.0
        for k in range(3):
            x += pose[0, k] * middle[run, k]
            y += pose[1, k] * middle[run, k]
            wide += abs(pose[0, k]) * half[run, k]
            high += abs(pose[1, k]) * half[run, k]
        # x / z over the box: the extremes are at its nearest or farthest depth.
        across = (
            fx * max((x + wide) / near, (x + wide) / far) + cx + most > view[29]
            and fx * min((x - wide) / near, (x - wide) / far) + cx - most < view[30]
        )
        along = (
            fy * max((y + high) / near, (y + high) / far) + cy + most > view[31]
            and fy * min((y - high) / near, (y - high) / far) + cy - most < view[32]
        )
        if scale[run] > WIDE * near:  # not splatted: select everything that can meet a requested ray
            reach = _REACH * scale[run]
            wide, high, far = wide + reach, high + reach, far + reach
            across |= (x + wide > 0 or fx * (x + wide) / far + cx > view[29]) and (
                x - wide < 0 or fx * (x - wide) / far + cx < view[30]
            )
            along |= (y + high > 0 or fy * (y + high) / far + cy > view[31]) and (
                y - high < 0 or fy * (y - high) / far + cy < view[32]
            )
        if across and along:
            for k in range(runs.shape[1]):
                if runs[run, k] >= 0:
                    marked[runs[run, k]] = True


def gray_gaussians(gaussians: Gaussians, rows: Int64) -> Gaussians:
    """The given `rows` (n,) of the Gaussians, all in one gray, for views without color."""
    g, n = gaussians, len(rows)
    shapes = (n, 3), (n, 3), (n, 4), (n,), (n, 1, 3)
    taken = Gaussians(*(np.empty(shape, np.float32) for shape in shapes))
    means, log_scales, quats, opacities = (
        as_kernel_array(a) for a in (g.means, g.log_scales, g.quats, g.opacity_logits)
    )
    _copy_rows(
        means, log_scales, quats, opacities, rows,
        taken.means, taken.log_scales, taken.quats, taken.opacity_logits, taken.sh,
    )  # fmt: skip
    return taken


@njit(cache=True, nogil=True)
def _copy_rows(
    means: Float32, log_scales: Float32, quats: Float32, opacity_logits: Float32, rows: Int64,
    new_means: Float32, new_log_scales: Float32, new_quats: Float32, new_opacity_logits: Float32, sh: Float32,
) -> None:  # fmt: skip
    """Copies the rows in one pass; four numpy operations, row by row, take several times as long."""
    for i, row in enumerate(rows):
        for k in range(3):
            new_means[i, k], new_log_scales[i, k], sh[i, 0, k] = means[row, k], log_scales[row, k], 0.0
        for k in range(4):
            new_quats[i, k] = quats[row, k]
        new_opacity_logits[i] = opacity_logits[row]


def along_a_curve(means: Float32) -> NDArray[np.int64]:
    """(N,) the position of each of `means` (N, 3) along a Morton curve through cells around the median. Points farther
    out count as in the outermost cells."""
    if not len(means):
        return np.zeros(0, np.int64)
    cells = np.floor((means - np.median(means, axis=0)) / _CELL) + _CELLS // 2
    index = cells.clip(0, _CELLS - 1).astype(np.int64)
    code = np.zeros(len(means), np.int64)
    for bit in range(_CELLS.bit_length() - 1):
        for axis in range(3):
            code |= ((index[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code
