"""The kernel that samples an image of a pinhole camera from narrow views around its position.

`nvsim.render.equirectangular` does this for one image of the whole sphere. Each pixel is sampled from the views whose
axis is closest to its ray. If two views are about equally close, they are blended, so that differences fade.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import Float32, Int64

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
BLEND = _F(0.03)
"""A view contributes if the cosine between its axis and the ray is less than this below the largest cosine."""


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _add_sample(
    colours: NDArray[Any],  # (views, S, S, 3), see `sample`
    solids: Float32,  # (views, S, S, 2)
    view: int,
    u: np.float32,  # column and line from the center of the first pixel; the next column and line exist too
    v: np.float32,
    weight: np.float32,
    pixel: Float32,  # (5,) the sample is added to it
) -> None:
    column, line = np.int64(u), np.int64(v)
    fu, fv = u - _F(column), v - _F(line)
    w00, w01 = weight * (_ONE - fv) * (_ONE - fu), weight * (_ONE - fv) * fu
    w10, w11 = weight * fv * (_ONE - fu), weight * fv * fu
    if colours.shape[0] > 0:
        for c in range(3):
            pixel[c] += (
                w00 * colours[view, line, column, c]
                + w01 * colours[view, line, column + 1, c]
                + w10 * colours[view, line + 1, column, c]
                + w11 * colours[view, line + 1, column + 1, c]
            )
    if solids.shape[0] > 0:
        for c in range(2):
            pixel[3 + c] += (
                w00 * solids[view, line, column, c]
                + w01 * solids[view, line, column + 1, c]
                + w10 * solids[view, line + 1, column, c]
                + w11 * solids[view, line + 1, column + 1, c]
            )


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def sample(
    colours: NDArray[Any],  # (views, S, S, 3) narrow views, float32 or uint8; (0, ...) if not needed
    solids: Float32,  # (views, S, S, 2) alpha, and alpha times meters along the ray; (0, ...) if not needed
    axes: Float32,  # (views, 3, 3) rows right, down and ahead of each narrow view, world
    focal: np.float32,  # focal length of the narrow views, pixels
    near: Int64,  # (n,) indices of the narrow views that the camera may see
    rotation: Float32,  # (3, 3) columns right, down and ahead of the camera, world
    pinhole_focal: np.float32,  # focal length of the camera, pixels; its principal point is the image center
    finer: int,  # samples per pixel in each direction
    colour: Float32,  # (H, W, 3) output, or (0, 0, 3)
    solid: Float32,  # (H, W, 2) output, or (0, 0, 2)
) -> None:
    """Fills the image (H, W) of the camera. Every pixel is the mean of `finer` x `finer` bilinear samples."""
    side = max(colours.shape[1], solids.shape[1])
    middle, most = _F(side) * _HALF - _HALF, _F(side - 2)
    height, width = max(colour.shape[0], solid.shape[0]), max(colour.shape[1], solid.shape[1])
    step, first = _ONE / _F(finer), (_ONE / _F(finer) - _ONE) * _HALF
    for row in prange(height):
        pixel = np.empty(5, np.float32)
        weights = np.empty(near.shape[0], np.float32)
        for column in range(width):
            # Measured from the principal point. The views are selected once for the whole pixel.
            u0, v0 = _F(column) + _HALF - _F(width) * _HALF, _F(row) + _HALF - _F(height) * _HALF
            a, b = u0 / pinhole_focal, v0 / pinhole_focal
            x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]
            y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]
            z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]
            scale = _ONE / math.sqrt(x * x + y * y + z * z)
            best = _ZERO
            for i in range(near.shape[0]):
                k = near[i]
                weights[i] = scale * (axes[k, 2, 0] * x + axes[k, 2, 1] * y + axes[k, 2, 2] * z)
                best = max(best, weights[i])
            total = _ZERO
            for i in range(near.shape[0]):
                weights[i] = max(weights[i] - best + BLEND, _ZERO)
                total += weights[i]
            pixel[:] = _ZERO
            for i in range(near.shape[0]):
                if weights[i] <= _ZERO:
                    continue
                k, weight = near[i], weights[i] * step * step / total
                for part in range(finer * finer):
                    a = (u0 + first + _F(part % finer) * step) / pinhole_focal
                    b = (v0 + first + _F(part // finer) * step) / pinhole_focal
                    x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]
                    y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]
                    z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]
                    ahead = focal / (axes[k, 2, 0] * x + axes[k, 2, 1] * y + axes[k, 2, 2] * z)
                    u = ahead * (axes[k, 0, 0] * x + axes[k, 0, 1] * y + axes[k, 0, 2] * z) + middle
                    v = ahead * (axes[k, 1, 0] * x + axes[k, 1, 1] * y + axes[k, 1, 2] * z) + middle
                    u, v = min(max(u, _ZERO), most), min(max(v, _ZERO), most)
                    _add_sample(colours, solids, k, u, v, weight, pixel)
            if colours.shape[0] > 0:
                for c in range(3):
                    colour[row, column, c] = pixel[c]
            if solids.shape[0] > 0:
                for c in range(2):
                    solid[row, column, c] = pixel[3 + c]
