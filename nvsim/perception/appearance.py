"""What the floor looks like, place by place, from many views: whatever looks different in one view (a person passing,
a chair that the cloud misses) is not floor there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.perception.roles import Float32, Image, Mask

_CELL = 0.05
_DARK = 10.0  # added before the logarithm, so that noise in black does not count as colour


@dataclass(frozen=True)
class AppearanceConfig:
    """farthest   metres: views from further away do not tell what a place looks like
    different  a pixel is strange from this many standard deviations of the frame's own floor on
    least      standard deviation of log colour that is always granted
    area       strange regions smaller than this share of the image stay floor
    most       where more than this share of the floor looks strange, the light has changed: nothing is taken out
    """

    farthest: float = 5.0
    different: float = 3.5
    least: float = 0.06
    area: float = 0.002
    most: float = 0.4


@dataclass(frozen=True, eq=False)
class Glimpse:
    """What one view says: floor (h, w) bool, ground (h, w, 2) metres where the rays meet the floor, distance (h, w)
    metres, image (h, w, 3) uint8 RGB at the same size."""

    floor: Mask
    ground: NDArray[np.floating]
    distance: Float32
    image: Image


@dataclass(frozen=True, eq=False)
class FloorAppearance:
    """colors (rows, columns, 3) float32, the median over the views of log(RGB + 10); known (rows, columns) float32, 1
    where any view saw floor; low (x, y) metres of the lower corner."""

    colors: Float32
    known: Float32
    low: NDArray[np.float64]
    config: AppearanceConfig

    @staticmethod
    def learn(glimpses: Iterable[Glimpse], config: AppearanceConfig) -> FloorAppearance | None:
        """The median view of every place, None when nothing was seen. The median over views forgets what stood there
        for a while, and, by parallax, what is wrongly taken for floor in some directions."""
        import cv2

        cells, colors = [], []
        for view in glimpses:
            inside = cv2.erode(view.floor.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            seen = inside & (view.distance < config.farthest)
            if not seen.any():
                continue
            index = np.floor(view.ground[seen] / _CELL).astype(np.int64)
            places, member = np.unique(index, axis=0, return_inverse=True)
            member = member.reshape(-1)
            number = np.bincount(member)
            logs = np.log(view.image[seen].astype(np.float32) + _DARK)
            cells.append(places)
            colors.append(np.stack([np.bincount(member, logs[:, c]) / number for c in range(3)], axis=1))
        if not cells:
            return None
        index, color = np.concatenate(cells), np.concatenate(colors)
        corner = index.min(axis=0) - 1
        columns, rows = (index.max(axis=0) - corner + 2).tolist()
        flat = (index[:, 1] - corner[1]) * columns + index[:, 0] - corner[0]
        median, known = np.zeros((rows * columns, 3), np.float32), np.zeros(rows * columns, np.float32)
        for channel in range(3):
            order = np.lexsort((color[:, channel], flat))
            sorted_flat = flat[order]
            start = np.flatnonzero(np.append(True, sorted_flat[1:] != sorted_flat[:-1]))
            length = np.diff(np.append(start, len(flat)))
            median[sorted_flat[start], channel] = color[order, channel][start + length // 2]
            known[sorted_flat[start]] = 1.0
        return FloorAppearance(median.reshape(rows, columns, 3), known.reshape(rows, columns), corner * _CELL, config)

    def strange(self, view: Glimpse) -> Mask:
        """(h, w) bool: the regions of the view's floor that do not look like the floor known there.

        The view's exposure and its slow changes (reflections, fall-off of light) are taken out first: the median
        difference of the whole floor, then a wide local mean of what fits.
        """
        import cv2

        from nvsim.perception.hybrid import large_regions

        nothing = np.zeros(view.floor.shape, bool)
        at = ((view.ground - self.low) / _CELL - 0.5).astype(np.float32)
        known = cv2.remap(self.known, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=0.0)
        expected = cv2.remap(self.colors, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=(0, 0, 0))
        floor = view.floor & (known > 0.5)
        if floor.sum() < 50:
            return nothing
        logs = np.log(view.image.astype(np.float32) + _DARK)
        rest = np.where(floor[..., None], logs - expected / np.maximum(known, 0.5)[..., None], 0).astype(np.float32)
        rest -= np.median(rest[floor], axis=0)
        fits = (floor & (np.abs(rest / self._spread(rest[floor])).max(axis=-1) < 3)).astype(np.float32)
        weight = cv2.GaussianBlur(fits, (0, 0), 16)[..., None]
        slow = cv2.GaussianBlur(fits[..., None] * rest, (0, 0), 16)
        local = np.where(floor[..., None], rest - slow / (weight + 0.02), 0).astype(np.float32)
        rest = np.asarray(cv2.blur(local, (3, 3)), np.float32)
        score = np.sqrt(np.mean((rest / self._spread(rest[floor])) ** 2, axis=-1))
        different = ((score > self.config.different) & floor).astype(np.uint8)
        different = cv2.morphologyEx(different, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        regions = large_regions((different > 0) & view.floor, self.config.area)
        return regions if regions.sum() < self.config.most * view.floor.sum() else nothing

    def _spread(self, values: Float32) -> Float32:
        spread: Float32 = np.maximum(1.4826 * np.median(np.abs(values), axis=0), self.config.least).astype(np.float32)
        return spread
