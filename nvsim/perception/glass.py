"""Detects glass in the point cloud: objects behind which many views show the pattern of the floor. The number of points
on an object does not matter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import distinct_cells
from nvsim.perception.roles import Float32, Mask

_CUBE = 0.3  # meters: edge of the cubes that are classified
_WINDOW = 11  # pixels: side of the window in which the observed pattern is compared with the known one
_PATTERN = 0.05  # standard deviation of log color that the known floor must have there
_ALIKE = 0.5  # least correlation of a pixel that shows the floor
_BEHIND = 0.4  # meters: the floor must be at least this far behind the object; nearer floor is that at its foot
_SHARE = 0.4  # least share of the pixels of a cube that must show the floor
_LEAST = 60  # least number of compared pixels of a cube
_BLOCK = 1 << 18  # points that are looked up at the same time, 20 MB


class GlassVotes:
    """Collects votes of views on which cubes of space are glass."""

    def __init__(self) -> None:
        self._cubes: list[NDArray[np.int64]] = []  # the distinct cubes of each view, and their numbers of pixels
        self._asked: list[NDArray[np.int64]] = []
        self._shown: list[NDArray[np.int64]] = []

    def add_votes(self, seen: Float32, expected: Float32, where: Mask, hits: Float32, behind: Float32) -> None:
        """Adds the votes of one view.

        seen, expected  (h, w, 3) log colors of the view and of the known floor
        where           (h, w) bool, pixels with a known floor color and an object before the floor
        hits            (h, w, 3) meters, world, the points of that object
        behind          (h, w) meters from the object to the floor behind it
        """
        import cv2

        asked = where & (behind > _BEHIND)
        if not asked.any():
            return

        def mean(x: Float32) -> Float32:
            return np.asarray(cv2.blur(x, (_WINDOW, _WINDOW)), np.float32)

        inside = mean(where.astype(np.float32)) + 1e-6
        a, b = (np.where(where, x.mean(axis=-1), 0).astype(np.float32) for x in (seen, expected))
        ma, mb = mean(a) / inside, mean(b) / inside
        va, vb = mean(a * a) / inside - ma * ma, mean(b * b) / inside - mb * mb
        correlation = (mean(a * b) / inside - ma * mb) / np.sqrt(np.maximum(va * vb, 1e-8))
        asked &= (vb > _PATTERN**2) & (inside > 0.7)
        cubes, member = distinct_cells(self._cube(hits[asked]))
        self._cubes.append(cubes)
        self._asked.append(np.bincount(member, minlength=len(cubes)))
        self._shown.append(np.bincount(member[correlation[asked] > _ALIKE], minlength=len(cubes)))

    def glass(self, points: Float32) -> Mask:
        """(N,) bool: whether each of `points` (N, 3), meters, world, is in a cube that is glass."""
        found = np.zeros(len(points), bool)
        if not self._cubes:
            return found
        cubes, member = distinct_cells(np.concatenate(self._cubes))
        asked, shown = (
            np.bincount(member, np.concatenate(counts), minlength=len(cubes)) for counts in (self._asked, self._shown)
        )
        clear = cubes[(asked >= _LEAST) & (shown > _SHARE * asked)]
        if not len(clear):
            return found
        low = clear.min(axis=0)
        sides = tuple(clear.max(axis=0) - low + 1)
        numbers = np.ravel_multi_index(tuple((clear - low).T), sides)
        for start in range(0, len(points), _BLOCK):
            at = self._cube(points[start : start + _BLOCK]) - low
            inside = ((at >= 0) & (at < sides)).all(axis=1)
            found[start + np.flatnonzero(inside)] = np.isin(np.ravel_multi_index(tuple(at[inside].T), sides), numbers)
        return found

    def _cube(self, points: Float32) -> NDArray[np.int64]:
        return np.floor(np.asarray(points, np.float64) / _CUBE).astype(np.int64)
