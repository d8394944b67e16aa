"""The floor texture during training, and the background before the first step: the mean color of the floor, and a
texture averaged from the images.

A texture that starts as the average of the views leaves only the details to Adam. Floor that few views see is also
textured from the first step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.floor_rays import meet_floor, pack_floor
from nvsim.render.floor_texture import add_texture, scatter_texture
from nvsim.render.sky import pack_camera
from nvsim.splats.types import FloorTexture
from nvsim.training.config import TrainingConfig
from nvsim.training.networks import Networks
from nvsim.training.views import TrainingView

MARGIN = 0.5
"""Meters of texture around the floor that the views show."""
REACH = 12.0
"""Meters from a camera beyond which floor does not enlarge the texture."""
DOUBT = 0.25
"""Weight of the coarser level against the views, in pixels."""
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


def initial_floor_paint(
    views: Sequence[TrainingView], floor: FloorSurface, config: TrainingConfig, seed: int
) -> tuple[Networks | None, LearnedTexture | None]:
    """The networks and the texture of a configuration, None for those that it does not use."""
    if not config.background and config.appearance.kind == "none":
        return None, None
    color = _mean_floor_color(views)
    networks = Networks(views, config, seed, color)
    if not config.texture:
        return networks, None
    hits = [_hits(view, floor) for view in views]
    texture = LearnedTexture(*_area(views, hits))
    _average(texture, views, hits, color)
    return networks, texture


def _mean_floor_color(views: Sequence[TrainingView]) -> NDArray[np.float64]:
    """(3,) mean color of the floor, 0 to 1; of all pixels if no view shows floor."""
    total, count = np.zeros(3), 0
    for view in views:
        total += view.image[view.floor].sum(axis=0, dtype=np.float64)
        count += int(view.floor.sum())
    if count == 0:
        return np.mean([v.image.reshape(-1, 3).mean(axis=0) for v in views], axis=0) / 255
    return total / count / 255


def _hits(view: TrainingView, floor: FloorSurface) -> Float32:
    k = view.camera.intrinsics
    hits = np.empty((3, k.height, k.width), np.float32)
    meet_floor(pack_camera(view.camera), *pack_floor(floor), view.floor, np.zeros(view.floor.shape, np.float32), hits)
    return hits


def _area(views: Sequence[TrainingView], hits: Sequence[Float32]) -> tuple[tuple[float, float], tuple[float, float]]:
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for view, hit in zip(views, hits, strict=True):
        eye = view.camera.position[:2]
        xy = hit[:2, hit[2] >= 0]
        near = xy[:, np.hypot(xy[0] - eye[0], xy[1] - eye[1]) < REACH]
        for points in (near, eye[:, None]):
            if points.size:
                low, high = np.minimum(low, points.min(axis=1)), np.maximum(high, points.max(axis=1))
    low, high = low - MARGIN, high + MARGIN
    return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))


def _average(
    texture: LearnedTexture, views: Sequence[TrainingView], hits: Sequence[Float32], color: NDArray[np.float64]
) -> None:
    # From coarse to fine, each level gets the mean of the residual of the coarser ones.
    for level in range(len(texture.table)):
        only = slice(level, level + 1)
        sums, weights = np.zeros_like(texture.values), np.zeros(len(texture.values), np.float32)
        for view, hit in zip(views, hits, strict=True):
            painted = np.zeros((3, *view.floor.shape), np.float32)
            texture.add(hit, painted)
            left = view.image.transpose(2, 0, 1) * np.float32(1 / 255) - color.astype(np.float32)[:, None, None]
            left = left - painted
            scatter_texture(
                hit, view.floor, texture.table[only], texture.sizes[only], texture.bounds, left, sums, weights
            )
        here = texture.level(level)
        texture.values[here] = sums[here] / (weights[here] + DOUBT)[:, None]
