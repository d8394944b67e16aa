"""Which things in the cloud one can see through: where the floor behind them shows its pattern in view after view, they
are glass, however many points they returned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import distinct_cells
from nvsim.perception.roles import Float32, Mask


@dataclass(frozen=True)
class GlassConfig:
    """cube     metres: edge of the cubes that are judged
    window   pixels across within which the pattern seen is held against the pattern known
    pattern  standard deviation of log colour that the known floor must have there
    alike    correlation from which on a pixel shows the floor
    behind   metres: the floor lies at least this far behind the thing, or it is only the floor at its foot
    share    of the pixels of a cube that must show the floor
    least    pixels that must have been held against it
    """

    cube: float = 0.3
    window: int = 11
    pattern: float = 0.05
    alike: float = 0.5
    behind: float = 0.4
    share: float = 0.4
    least: int = 60


class SeeThrough:
    """Votes of views about cubes of space."""

    def __init__(self, config: GlassConfig) -> None:
        self._config = config
        self._cubes: list[NDArray[np.int64]] = []
        self._shown: list[NDArray[np.bool_]] = []

    def vote(self, seen: Float32, expected: Float32, where: Mask, hits: Float32, behind: Float32) -> None:
        """One view: log colours `seen` and `expected` (h, w, 3) of the floor, `where` (h, w) the expected is known and
        something stands before it, `hits` (h, w, 3) metres, world, where that thing is, and how many metres `behind`
        (h, w) it the floor lies."""
        import cv2

        c = self._config
        asked = where & (behind > c.behind)
        if not asked.any():
            return

        def mean(x: Float32) -> Float32:
            return np.asarray(cv2.blur(x, (c.window, c.window)), np.float32)

        inside = mean(where.astype(np.float32)) + 1e-6
        a, b = (np.where(where, x.mean(axis=-1), 0).astype(np.float32) for x in (seen, expected))
        ma, mb = mean(a) / inside, mean(b) / inside
        va, vb = mean(a * a) / inside - ma * ma, mean(b * b) / inside - mb * mb
        correlation = (mean(a * b) / inside - ma * mb) / np.sqrt(np.maximum(va * vb, 1e-8))
        asked &= (vb > c.pattern**2) & (inside > 0.7)
        self._cubes.append(self._cube(hits[asked]))
        self._shown.append(correlation[asked] > c.alike)

    def glass(self, points: Float32) -> Mask:
        """(N,) whether each of `points` (N, 3) lies in a cube that the views see through."""
        if not self._cubes or len(points) == 0:
            return np.zeros(len(points), bool)
        votes, of_points = np.concatenate(self._cubes), self._cube(points)
        cubes, member = distinct_cells(np.concatenate([votes, of_points]))
        asked = np.bincount(member[: len(votes)], minlength=len(cubes))
        shown = np.bincount(member[: len(votes)], np.concatenate(self._shown), minlength=len(cubes))
        clear = (asked >= self._config.least) & (shown > self._config.share * asked)
        found: Mask = clear[member[len(votes) :]]
        return found

    def _cube(self, points: Float32) -> NDArray[np.int64]:
        return np.floor(np.asarray(points, np.float64) / self._config.cube).astype(np.int64)
