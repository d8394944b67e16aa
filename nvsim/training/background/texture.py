"""The floor texture during training: grids over world x, y in one vector of texels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.render.floor_texture import add_texture, scatter_texture
from nvsim.splats.types import FloorTexture

Float32 = NDArray[np.float32]

TEXELS = (0.4, 0.1, 0.04, 0.015)
"""Texel sizes in meters, coarse to fine."""
LARGEST = 2600
"""Greatest number of texels of a level along one side; a larger area gets larger texels."""


class LearnedTexture:
    """Texels over an area, initially zero. The optimizer changes `values` (n, 3) in place, from `gradient` (n, 3)."""

    def __init__(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        self._low, self._high = low, high
        self.bounds = np.array([*low, *high], np.float32)
        table, sizes, first = [], [], 0
        for texel in TEXELS:
            columns = int(np.clip(np.ceil((high[0] - low[0]) / texel), 2, LARGEST))
            rows = int(np.clip(np.ceil((high[1] - low[1]) / texel), 2, LARGEST))
            table.append((first, rows, columns))
            sizes.append(max((high[0] - low[0]) / columns, (high[1] - low[1]) / rows))
            first += rows * columns
        self.table, self.sizes = np.array(table, np.int64), np.array(sizes, np.float32)
        self.values = np.zeros((first, 3), np.float32)
        self.gradient = np.zeros_like(self.values)

    def add(self, hits: Float32, background: Float32) -> None:
        """Adds the texture to `background` (3, H, W); `hits` (3, H, W) come from `floor_rays.meet_floor`."""
        add_texture(hits, self.table, self.sizes, self.bounds, self.values, background)

    def collect(self, hits: Float32, floor: NDArray[np.bool_], d_background: Float32) -> None:
        """Adds to `gradient` from `d_background` (3, H, W), the gradient of the background, only within `floor` (H, W).
        Elsewhere, colors seen through half-opaque Gaussians would be painted onto the floor."""
        scatter_texture(hits, floor, self.table, self.sizes, self.bounds, d_background, self.gradient, _UNWEIGHTED)

    def level(self, index: int) -> slice:
        """The texels of one level within `values`."""
        first, rows, columns = self.table[index]
        return slice(int(first), int(first + rows * columns))

    def exported(self) -> FloorTexture:
        """A copy in the form that the renderer uses."""
        levels = tuple(
            self.values[self.level(i)].reshape(rows, columns, 3).copy()
            for i, (_, rows, columns) in enumerate(self.table)
        )
        return FloorTexture(levels, self._low, self._high)


_UNWEIGHTED = np.empty(0, np.float32)
