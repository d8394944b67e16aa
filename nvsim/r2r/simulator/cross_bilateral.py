"""Fills holes in depth images from pixels that are near in position and in brightness, from coarse to fine.

Source: Silberman et al., "Indoor segmentation and support inference from RGBD images" (ECCV 2012). The parameters are
those of Matterport3DSimulator's `cbf`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_RADIUS = 5  # pixels at each level
_LEVELS = ((12.0, 0.2), (5.0, 0.08), (8.0, 0.02))  # sigma in pixels and in brightness, from the finest level


def cbf(depth: Any, intensity: Any, mask: Any, result: Any) -> None:
    """Writes `depth` with filled holes into `result`. Holes are the pixels with `mask` not 0.

    All are uint8 arrays of one shape (H, W). As in Matterport3DSimulator, the bytes in memory are interpreted as
    columns of length H.

    Raises ValueError for other types or shapes.
    """
    arrays = [np.asarray(a) for a in (depth, intensity, mask, result)]
    shape = arrays[0].shape
    if len(shape) != 2 or any(a.shape != shape or a.dtype.itemsize != 1 or not a.flags.c_contiguous for a in arrays):
        raise ValueError("cbf needs four contiguous arrays of one byte per pixel and of one shape (H, W).")
    columns = shape[::-1]
    known, light, hole = (a.reshape(columns) for a in arrays[:3])
    levels = []
    for k in range(len(_LEVELS)):
        width, height = (int(side / 2**k) for side in columns)
        x, y = ((np.arange(n) * s // max(n, 1)).astype(int) for n, s in zip((width, height), columns))
        levels.append([a[np.ix_(x, y)] for a in (known, light, hole)])
    filled = valid = missing = coarse = np.zeros((0, 0), np.float32)
    for k in reversed(range(len(_LEVELS))):
        values, brightness = (np.array(a, np.float32) / np.float32(255) for a in levels[k][:2])
        above, missing = missing, levels[k][2] != 0
        usable = ~missing
        if filled.size:
            x, y = (np.arange(n) * s // n for n, s in zip(missing.shape, filled.shape))
            from_above = np.where(above, filled, coarse)[np.ix_(x, y)]
            values, usable = np.where(missing, from_above, values), np.where(missing, valid[np.ix_(x, y)], usable)
        filled, valid, coarse = np.zeros_like(values), usable.copy(), values
        _fill(values, brightness, missing, usable, *_LEVELS[k], filled, valid)
    found = np.where(missing, (filled * np.float32(255)).astype(np.uint8), known)
    arrays[3].reshape(columns)[...] = found


def _fill(
    values: NDArray[np.float32],  # (W, H)
    brightness: NDArray[np.float32],
    missing: NDArray[np.bool_],
    usable: NDArray[np.bool_],
    spread: float,
    contrast: float,
    filled: NDArray[np.float32],  # output
    valid: NDArray[np.bool_],  # output
) -> None:
    x, y = np.nonzero(missing)
    values, brightness, usable = np.pad(values, _RADIUS), np.pad(brightness, _RADIUS), np.pad(usable, _RADIUS)
    light = brightness[x + _RADIUS, y + _RADIUS]
    weights, total = np.zeros(len(x)), np.zeros(len(x))
    for i, j in np.ndindex(2 * _RADIUS + 1, 2 * _RADIUS + 1):
        place = ((i - _RADIUS) ** 2 + (j - _RADIUS) ** 2) / (2 * spread * spread)
        off = (brightness[x + i, y + j] - light).astype(np.float64)
        weight = np.exp(-place - off * off / (2 * contrast * contrast)) * usable[x + i, y + j]
        weights += weight
        total += weight * values[x + i, y + j]
    found = weights > 0
    x, y = x[found], y[found]
    filled[x, y] = total[found] / weights[found]
    valid[x, y] = True
