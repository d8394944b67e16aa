"""The usual color of the floor at every place, learned from many views. Floor pixels of one view that differ from it
(a passing person, a chair that the cloud misses) are not floor."""

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
_DARK = 10.0  # added before the logarithm, so that noise in dark pixels does not count as color


_FARTHEST = 5.0  # meters: pixels whose floor is farther away are not used to learn its color
_DIFFERENT = 4.5  # a pixel is strange if it deviates by more than this many deviations of the frame's own floor
_LEAST = 0.06  # lower limit of that standard deviation, in log color
_AREA = 0.002  # strange regions smaller than this share of the image stay floor
_ALIKE = 2.5  # occluded floor can be visible through glass if it deviates by less than this many deviations
_WINDOW = 0.006  # smallest share of the image that a region visible through glass must cover
_PATTERN = 0.03  # standard deviation of log color that a floor must have for its pattern to be recognized
_CORRELATION = 0.65  # least correlation between the observed and the known pattern for it to be recognized
_MOST = 0.4  # if more than this share of the floor is strange, the light has changed and no floor is removed


@dataclass(frozen=True, eq=False)
class FloorObservation:
    """The floor pixels of one view.

    floor     (h, w) bool
    ground    (h, w, 2) meters, the points where the rays meet the floor
    distance  (h, w) meters along the rays to these points
    image     (h, w, 3) uint8 RGB
    """

    floor: Mask
    ground: NDArray[np.floating]
    distance: Float32
    image: Image


@dataclass(frozen=True, eq=False)
class FloorAppearance:
    """A map of floor colors.

    colors  (rows, columns, 3) float32, the median over the views of log(RGB + 10)
    known   (rows, columns) float32, 1 for cells seen as floor in any view
    low     (2,) x, y meters of the lower corner
    """

    colors: Float32
    known: Float32
    low: NDArray[np.float64]

    @staticmethod
    def learn(glimpses: Iterable[FloorObservation]) -> FloorAppearance | None:
        """Computes the median color of every floor cell over the views; None if no view shows floor. The median ignores
        temporary objects. Because of parallax it also ignores objects that some views mistake for floor."""
        import cv2

        cells, colors = [], []
        for view in glimpses:
            inside = cv2.erode(view.floor.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            seen = inside & (view.distance < _FARTHEST)
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
        return FloorAppearance(median.reshape(rows, columns, 3), known.reshape(rows, columns), corner * _CELL)

    def unusual_regions(self, view: FloorObservation) -> Mask:
        """(h, w) bool: the regions of the view's floor that differ from the known floor color there."""
        import cv2

        expected, known = self.expected_colors(view.ground)
        floor = view.floor & known
        score = self._score(view, expected, floor, floor)
        different = ((score > _DIFFERENT) & floor).astype(np.uint8)
        closed = cv2.morphologyEx(different, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0
        regions = large_regions(closed & view.floor, _AREA)
        usual: Mask = regions if regions.sum() < _MOST * view.floor.sum() else np.zeros_like(regions)
        return usual

    def similarity(self, view: FloorObservation) -> Float32:
        """(h, w) float32, 0 to 1: how similar every pixel is to the known floor where its ray meets the ground.
        Occluded floor counts too. The value is 0.5 at the limit of strange pixels and 0 without known floor."""
        expected, known = self.expected_colors(view.ground)
        score = self._score(view, expected, known, view.floor & known)
        like: Float32 = np.where(known, 0.5 ** ((score / _DIFFERENT) ** 2), 0).astype(np.float32)
        return like

    def glass_regions(self, view: FloorObservation, hidden: Mask) -> Mask:
        """(h, w) bool: the regions of `hidden` (h, w), occluded floor, that still show the pattern of the floor, so
        that the occluder is glass. The test is the normalized correlation of the patterns after slow changes are
        removed. Color alone does not count, so plain floors are never found behind other objects."""
        import cv2

        expected, known = self.expected_colors(view.ground)
        region = hidden & known
        score = self._score(view, expected, region, view.floor & known)
        alike = ((score < _ALIKE) & region).astype(np.uint8)
        opened = cv2.morphologyEx(alike, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        regions = large_regions(opened, _WINDOW)
        if not regions.any():
            return regions
        inside = regions.astype(np.float32)[..., None]
        seen, there = (
            x - cv2.GaussianBlur(x * inside, (0, 0), 5) / (cv2.GaussianBlur(inside, (0, 0), 5)[..., None] + 1e-3)
            for x in (self.log_colors(view.image), expected)
        )
        count, labels = cv2.connectedComponents(regions.astype(np.uint8))
        keep = np.zeros(count, bool)
        for k in range(1, count):
            a, b = seen[labels == k], there[labels == k]
            both, sa, sb = float(np.mean(a * b)), float(np.mean(a * a)), float(np.mean(b * b))
            keep[k] = sb > _PATTERN**2 and both > _CORRELATION * np.sqrt(sa * sb)
        through = cv2.morphologyEx(keep[labels].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        found: Mask = (through > 0) & hidden
        return found

    @staticmethod
    def log_colors(image: Image) -> Float32:
        """(h, w, 3) log colors of an `image` (h, w, 3) uint8 RGB, comparable with `expected`."""
        logs: Float32 = np.log(image.astype(np.float32) + _DARK)
        return logs

    def expected_colors(self, ground: NDArray[np.floating]) -> tuple[Float32, Mask]:
        """The known floor colors (h, w, 3), log, at places `ground` (h, w, 2), meters, and which are known (h, w)
        bool."""
        import cv2

        at = ((ground - self.low) / _CELL - 0.5).astype(np.float32)
        known = cv2.remap(self.known, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=0.0)
        expected = cv2.remap(self.colors, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=(0, 0, 0))
        return np.asarray(expected / np.maximum(known, 0.5)[..., None], np.float32), known > 0.5

    def _score(self, view: FloorObservation, expected: Float32, region: Mask, basis: Mask) -> Float32:
        """(h, w) deviation of the pixels of `region`, in standard deviations of the view's own floor (`basis`).

        The exposure and slow changes of the view (reflections, light fall-off) are removed first. They are the median
        difference over the whole floor, and then a wide local mean over pixels that fit.
        """
        import cv2

        either = region | basis
        rest = np.where(either[..., None], self.log_colors(view.image) - expected, 0).astype(np.float32)
        # Too little floor to estimate the exposure: use that of the trajectory and allow 1.5 times the deviation.
        alone = basis.sum() < _FEW
        spread = np.full(3, 1.5 * _LEAST, np.float32)
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
        spread: Float32 = np.maximum(1.4826 * np.median(np.abs(values), axis=0), _LEAST).astype(np.float32)
        return spread
