"""Which Gaussians may touch a few tiles of a view, found without looking at every one: runs of neighbours are ruled out
together. What is left is a superset of what the kernels would take, so that the image stays the same to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.kernel_types import Float32, Int32, Mask
from nvsim.render.packed_camera import limit, pack
from nvsim.splats.types import Gaussians

_RUN = 128  # Gaussians that are ruled out together
_CELL, _CELLS = 0.5, 1024  # metres and number of the cells along which neighbours are found
_WIDE = np.log(0.3)  # of Gaussians with a larger scale, metres, runs are made apart: they reach far
_WIDEST = 30 * np.log(2)  # of the logarithm of a scale, as the kernels bound it
_REACH = np.sqrt(2 * np.log(255))  # standard deviations, as in the kernels
_GRACE = 1.0  # pixels for what single precision rounds away


class Nearby:
    """The runs of one set of Gaussians, for as long as these stay where they are."""

    def __init__(self, gaussians: Gaussians) -> None:
        means = gaussians.means
        whole = np.flatnonzero(np.isfinite(means).all(axis=1))  # the kernels draw no others
        scale = np.nan_to_num(gaussians.log_scales[whole].max(axis=1), nan=_WIDEST).clip(-_WIDEST, _WIDEST)
        order = np.lexsort((_along_a_curve(means[whole]), scale > _WIDE))
        starts = np.arange(0, len(order), _RUN)
        self._runs = np.full((len(starts), _RUN), -1, np.int32)
        self._runs.reshape(-1)[: len(order)] = whole[order]
        if len(order):
            placed = means[whole[order]].astype(np.float64)
            low, high = np.minimum.reduceat(placed, starts), np.maximum.reduceat(placed, starts)
            self._middle, self._half = (low + high) / 2, (high - low) / 2
            self._scale = np.exp(np.maximum.reduceat(scale[order].astype(np.float64), starts))

    def rows(self, camera: Camera, tiles: Mask) -> Int32:
        """(n,) rows of the Gaussians that `tiles` (lines, columns) of the camera's image may show, ascending."""
        if not len(self._runs):
            return np.empty(0, np.int32)
        view = pack(camera, True).astype(np.float32)
        limit(view, tiles)
        fx, fy, cx, cy = (float(v) for v in view[12:16])
        filtered, nearest, slope = (float(view[i]) for i in (25, 27, 28))
        left, right, top, bottom = (float(v) for v in view[29:33])
        turn = camera.world_to_camera[:3, :3].astype(np.float64)
        middle = self._middle @ turn.T + camera.world_to_camera[:3, 3]
        half = self._half @ np.abs(turn).T
        far = middle[:, 2] + half[:, 2]
        near = np.maximum(middle[:, 2] - half[:, 2], nearest)
        kept = far > nearest
        far = np.maximum(far, near)
        stretch = self._scale / near * max(fx, fy) * slope
        most = _REACH * np.sqrt(stretch * stretch + filtered) + _GRACE
        for axis, focal, centre, first, last in ((0, fx, cx, left, right), (1, fy, cy, top, bottom)):
            low, high = middle[:, axis] - half[:, axis], middle[:, axis] + half[:, axis]
            # x / z over the box of a run: the extremes lie at its nearest or farthest depth.
            kept &= focal * np.maximum(high / near, high / far) + centre - 0.5 + most > first
            kept &= focal * np.minimum(low / near, low / far) + centre - 0.5 - most < last
        rows = self._runs[kept].reshape(-1)
        rows = rows[rows >= 0]
        rows.sort()
        return rows


def uncoloured(gaussians: Gaussians, rows: Int32) -> Gaussians:
    """Those `rows` of them, in one grey: for views of which nobody asks the colour."""
    means, log_scales, quats, opacity_logits = (
        a.take(rows, axis=0) for a in (gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits)
    )
    return Gaussians(means, log_scales, quats, opacity_logits, np.zeros((len(rows), 1, 3), np.float32))


def _along_a_curve(means: Float32) -> NDArray[np.int64]:
    """(N,) the place of each (N, 3) along a Morton curve through cells around the median; what lies farther out counts
    as in the outermost."""
    if not len(means):
        return np.zeros(0, np.int64)
    cells = np.floor((means - np.median(means, axis=0)) / _CELL) + _CELLS // 2
    index = cells.clip(0, _CELLS - 1).astype(np.int64)
    code = np.zeros(len(means), np.int64)
    for bit in range(_CELLS.bit_length() - 1):
        for axis in range(3):
            code |= ((index[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code
