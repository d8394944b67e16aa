"""What the floor looks like, place by place, from many views: what looks different in one view (a person passing,
a chair that the cloud misses) is not floor there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import distinct_cells, grid_size
from nvsim.perception.hybrid import large_regions
from nvsim.perception.roles import Float32, Image, Mask

_CELL = 0.05
_FEW = 300  # pixels
_DARK = 10.0  # added before the logarithm, so that noise in black does not count as colour


@dataclass(frozen=True)
class AppearanceConfig:
    """farthest   metres: views from further away do not tell what a place looks like
    different  a pixel is strange from this many standard deviations of the frame's own floor on
    least      standard deviation of log colour that is always granted
    area       strange regions smaller than this share of the image stay floor
    alike      hidden floor may shine through where it is off by less than this many standard deviations
    window     share of the image from which on a region that shines through is believed
    pattern    standard deviation of log colour that a floor must have for its pattern to be recognised
    correlation  of the pattern seen with the pattern known, from which on it is recognised
    most       where more than this share of the floor looks strange, the light has changed: nothing is taken out
    """

    farthest: float = 5.0
    different: float = 4.5
    least: float = 0.06
    area: float = 0.002
    alike: float = 2.5
    window: float = 0.006
    pattern: float = 0.03
    correlation: float = 0.65
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
            places, member = distinct_cells(index)
            number = np.bincount(member)
            logs = np.log(view.image[seen].astype(np.float32) + _DARK)
            cells.append(places)
            colors.append(np.stack([np.bincount(member, logs[:, c]) / number for c in range(3)], axis=1))
        if not cells:
            return None
        index, color = np.concatenate(cells), np.concatenate(colors)
        corner = index.min(axis=0) - 1
        columns, rows = (index.max(axis=0) - corner + 2).tolist()
        grid_size(np.zeros(2), _CELL * np.array([columns, rows]), _CELL, "the views of the floor")
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
        """(h, w) bool: the regions of the view's floor that do not look like the floor known there."""
        import cv2

        expected, known = self.expected(view)
        floor = view.floor & known
        score = self._score(view, expected, floor, floor)
        different = ((score > self.config.different) & floor).astype(np.uint8)
        closed = cv2.morphologyEx(different, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0
        regions = large_regions(closed & view.floor, self.config.area)
        usual: Mask = regions if regions.sum() < self.config.most * view.floor.sum() else np.zeros_like(regions)
        return usual

    def likeness(self, view: Glimpse) -> Float32:
        """(h, w) float32, 0 to 1: how much every pixel looks like the floor known where its ray meets the ground,
        also where something stands before it; 0.5 where it begins to be strange, 0 where no floor is known."""
        expected, known = self.expected(view)
        score = self._score(view, expected, known, view.floor & known)
        like: Float32 = np.where(known, 0.5 ** ((score / self.config.different) ** 2), 0).astype(np.float32)
        return like

    def shining_through(self, view: Glimpse, hidden: Mask) -> Mask:
        """(h, w) bool: the regions of `hidden`, floor with something before it, that show the floor's own pattern all
        the same: what stands before them is glass. The pattern decides (normalised correlation of what is left when
        slow changes are taken out), not the colour, so that plain floors never shine through anything."""
        import cv2

        expected, known = self.expected(view)
        region = hidden & known
        score = self._score(view, expected, region, view.floor & known)
        alike = ((score < self.config.alike) & region).astype(np.uint8)
        opened = cv2.morphologyEx(alike, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        regions = large_regions(opened, self.config.window)
        if not regions.any():
            return regions
        inside = regions.astype(np.float32)[..., None]
        seen, there = (
            x - cv2.GaussianBlur(x * inside, (0, 0), 5) / (cv2.GaussianBlur(inside, (0, 0), 5)[..., None] + 1e-3)
            for x in (self.logs(view), expected)
        )
        count, labels = cv2.connectedComponents(regions.astype(np.uint8))
        keep = np.zeros(count, bool)
        for k in range(1, count):
            a, b = seen[labels == k], there[labels == k]
            both, sa, sb = float(np.mean(a * b)), float(np.mean(a * a)), float(np.mean(b * b))
            keep[k] = sb > self.config.pattern**2 and both > self.config.correlation * np.sqrt(sa * sb)
        through = cv2.morphologyEx(keep[labels].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        found: Mask = (through > 0) & hidden
        return found

    @staticmethod
    def logs(view: Glimpse) -> Float32:
        """(h, w, 3) log colours of a view, comparable with `expected`."""
        logs: Float32 = np.log(view.image.astype(np.float32) + _DARK)
        return logs

    def expected(self, view: Glimpse) -> tuple[Float32, Mask]:
        """The known colours (h, w, 3) at the view's pixels, and where they are known."""
        import cv2

        at = ((view.ground - self.low) / _CELL - 0.5).astype(np.float32)
        known = cv2.remap(self.known, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=0.0)
        expected = cv2.remap(self.colors, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=(0, 0, 0))
        return np.asarray(expected / np.maximum(known, 0.5)[..., None], np.float32), known > 0.5

    def _score(self, view: Glimpse, expected: Float32, region: Mask, basis: Mask) -> Float32:
        """(h, w) how many standard deviations of the view's own floor (`basis`) a pixel of `region` is off.

        The view's exposure and its slow changes (reflections, fall-off of light) are taken out first: the median
        difference of the whole floor, then a wide local mean of what fits.
        """
        import cv2

        either = region | basis
        rest = np.where(either[..., None], self.logs(view) - expected, 0).astype(np.float32)
        # Too little floor to tell the exposure from: the trajectory's own is taken, and half as much again is granted.
        alone = basis.sum() < _FEW
        spread = np.full(3, 1.5 * self.config.least, np.float32)
        if not alone:
            rest -= np.median(rest[basis], axis=0)
            spread = self._spread(rest[basis])
        fits = (either & (np.abs(rest / spread).max(axis=-1) < 3)).astype(np.float32)
        weight = cv2.GaussianBlur(fits, (0, 0), 16)[..., None]
        slow = cv2.GaussianBlur(fits[..., None] * rest, (0, 0), 16)
        local = np.where(either[..., None], rest - slow / (weight + 0.02), 0).astype(np.float32)
        rest = np.asarray(cv2.blur(local, (3, 3)), np.float32)
        if not alone:
            spread = self._spread(rest[basis])
        score: Float32 = np.sqrt(np.mean((rest / spread) ** 2, axis=-1)).astype(np.float32)
        return score

    def _spread(self, values: Float32) -> Float32:
        spread: Float32 = np.maximum(1.4826 * np.median(np.abs(values), axis=0), self.config.least).astype(np.float32)
        return spread
