"""Corridors on the floor, the lattice directions in which they are measured, and the positions that steps lead to.

A corridor is measured wider than any supported robot, in cells of equal ground area, so that its evidence is valid
for other robots. Direction k is `lattice_offset` + 45 k degrees; 0 is +y, right is positive.

Adding steps one by one would give positions that differ in the last bit between paths, and evidence that is almost,
but not exactly, that of another build. Each position is shifted slightly from its lattice point, by an offset derived
from its counts, so that no two paths have exactly equal lengths.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence
from nvsim.mapping.config import WIDEST, MappingConfig
from nvsim.mapping.evidence.traversed_floor import CLIMB

HeightAt = Callable[[NDArray[np.floating]], NDArray[np.floating]]
"""The height of the floor (...) at world points (..., 3), meters. z of a point is the height of a camera, or of a
floor, near which the floor is searched. In a building of one storey, points may be (..., 2)."""
SupportAt = Callable[[NDArray[np.floating]], NDArray[np.bool_]]
"""Whether the floor at such points is known, (...) bool."""

DIRECTIONS = 8
NEAR, DEPTH, WIDTH = 0.05, 0.1, WIDEST  # meters: start of the first row, depth of a row, measured width
CELLS = 18  # across the width: 0.05 m each
# Half of the measured width: the largest robot radius that the evidence supports.
_BEYOND = WIDTH / 2

_ACROSS = ((np.arange(CELLS) + 0.5) / CELLS - 0.5) * WIDTH  # meters to the right of the middle


def headings(config: MappingConfig) -> NDArray[np.float64]:
    """Return the (8,) headings of the directions in radians, read-only."""
    return _headings(config.lattice_offset)


@lru_cache(maxsize=4)
def _headings(offset: float) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.radians(offset + 45.0 * np.arange(DIRECTIONS))
    found.setflags(write=False)
    return found


def offset_ahead(heading: float, distance: float) -> NDArray[np.float64]:
    """Return the (2,) world x, y offset of a point `distance` meters ahead."""
    return distance * np.array([np.sin(heading), np.cos(heading)])


@dataclass(frozen=True)
class Corridor:
    """A corridor from `start` to `target`, both (x, y) in meters, world. `eye` is world z of the camera over the start,
    which selects the storey; None if there is only one."""

    start: tuple[float, float]
    target: tuple[float, float]
    eye: float | None = None

    @cached_property
    def length(self) -> float:
        return float(np.hypot(self.target[0] - self.start[0], self.target[1] - self.start[1]))

    @cached_property
    def heading(self) -> float:
        """Radians in [0, 2 pi)."""
        return float(np.arctan2(self.target[0] - self.start[0], self.target[1] - self.start[1]) % (2 * np.pi))

    @cached_property
    def rows(self) -> int:
        return max(1, int(np.ceil((self.length + _BEYOND - NEAR) / DEPTH - 1e-9)))

    def cells(self) -> NDArray[np.float64]:
        """Return (rows, CELLS, 2) world x, y in meters of the cell centers, rows from near to far, cells from left to
        right."""
        found = np.empty((self.rows, CELLS, 2))
        self._place(found)
        return found

    def _place(self, found: NDArray[np.float64]) -> None:
        x, y = offset_ahead(self.heading, 1.0).tolist()
        along = _meters_ahead(self.rows)
        found[..., 0] = (self.start[0] + along * x) + _ACROSS * y
        found[..., 1] = (self.start[1] + along * y) - _ACROSS * x

    def ground(self, floor_at: HeightAt) -> NDArray[np.float64]:
        """Return (rows, CELLS, 3) cell centers on the floor, meters, world, read-only. In stacked storeys, it is the
        floor that continues from the start; slopes are followed row by row."""
        return _floor_points(self, floor_at)

    def _compute_ground(self, floor_at: HeightAt) -> NDArray[np.float64]:
        ground = np.empty((self.rows, CELLS, 3))
        self._place(ground)
        if self.eye is None:
            ground[..., 2] = floor_at(ground[..., :2])
            return ground
        level = ground[..., 2] = _level(self.start, self.eye, floor_at)
        found = np.asarray(floor_at(ground), np.float64)
        if np.abs(found - level).max() > CLIMB:
            for row in ground:
                row[:, 2] = level
                row[:, 2] = floor_at(row)
                level = row_median(row[:, 2])
            return ground
        ground[..., 2] = found
        return ground

    def uses_stairs(self, floor_at: HeightAt) -> bool:
        """Whether the corridor leads up or down stairs."""
        return abs(self.end(floor_at) - row_median(self.ground(floor_at)[0, :, 2])) > CLIMB

    def end(self, floor_at: HeightAt) -> float:
        """Return world z in meters of the floor at the target, as `ground` follows it."""
        row = round((self.length - NEAR) / DEPTH - 0.5)
        return row_median(self.ground(floor_at)[min(max(row, 0), self.rows - 1), :, 2])


def row_median(heights: NDArray[np.float64]) -> float:
    """Return the median of the floor heights (CELLS,) of a row; CELLS is even. The median of numpy takes ten times as
    long."""
    ordered = sorted(heights.tolist())
    return float(ordered[CELLS // 2 - 1] + ordered[CELLS // 2]) / 2


@lru_cache(maxsize=256)
def _meters_ahead(rows: int) -> NDArray[np.float64]:
    """(rows, 1) meters ahead to the middle of each row, read-only."""
    return np.asarray(NEAR + (np.arange(rows)[:, None] + 0.5) * DEPTH)


@lru_cache(maxsize=16)
def _level(start: tuple[float, float], eye: float, floor_at: HeightAt) -> float:
    return float(floor_at(np.array([*start, eye])))


# The corridors of a viewpoint are used several times: to render, to measure, and to find their ends.
@lru_cache(maxsize=1024)
def _floor_points(corridor: Corridor, floor_at: HeightAt) -> NDArray[np.float64]:
    found = corridor._compute_ground(floor_at)
    found.setflags(write=False)
    return found


def view_of(corridor: Corridor, config: MappingConfig) -> int:
    """Return the lattice direction whose view shows `corridor`: the nearest. All corridors use this rule, so that
    evidence does not depend on how many views were rendered."""
    off = [
        round(1e6 * abs((corridor.heading - heading + math.pi) % (2 * math.pi) - math.pi))
        for heading in headings(config).tolist()
    ]
    return off.index(min(off))


def evidence_without_obstacles(corridor: Corridor, viewpoint: str, floor_at: HeightAt, support: SupportAt) -> Evidence:
    """Return the evidence of `corridor` on level floor without obstacles, as far as its floor is known."""
    known = np.asarray(support(corridor.ground(floor_at)), bool)
    empty, full = np.zeros(known.shape, np.uint8), np.full(known.shape, 255, np.uint8)
    place = viewpoint, -1, corridor.heading, corridor.length
    size = NEAR, DEPTH, WIDTH
    return Evidence(*place, empty, full, known, *size, -1, corridor.target, reach=full, mass=empty, network_up=full)


_AXES = DIRECTIONS // 2  # direction k + 4 is opposite to direction k


class Lattice:
    """Stores for the id of every viewpoint the start that it descends from and its counts of steps along four axes."""

    def __init__(self, config: MappingConfig) -> None:
        self._jitter = config.jitter
        self._steps = [offset_ahead(h, config.tau_dist) for h in headings(config)[:_AXES]]
        self._at: dict[str, tuple[tuple[float, float], tuple[int, ...]]] = {}

    def begin(self, id: str, xy: tuple[float, float]) -> None:
        """Add a start at `xy`, from which steps descend."""
        self._at[id] = (xy, (0,) * _AXES)

    def record_step(self, id: str, origin: str, direction: int) -> None:
        """Record that the step from `origin` leads to the viewpoint `id`."""
        start, counts = self._at[origin]
        self._at[id] = (start, self._counts_after_step(counts, direction))

    def target(self, id: str, direction: int) -> tuple[float, float]:
        """Return world x, y in meters to which the step from `id` leads."""
        start, counts = self._at[id]
        moved = self._counts_after_step(counts, direction)
        offset = sum((n * step for n, step in zip(moved, self._steps, strict=True)), np.zeros(2))
        offset += self._random_offset(start, moved)
        return float(start[0] + offset[0]), float(start[1] + offset[1])

    def _random_offset(self, start: tuple[float, float], counts: tuple[int, ...]) -> NDArray[np.float64]:
        """(2,) meters, uniform in a disc of radius `jitter`; zero for the start itself."""
        if not self._jitter or not any(counts):
            return np.zeros(2)
        drawn = hashlib.blake2b(repr((round(start[0], 3), round(start[1], 3), counts)).encode(), digest_size=8).digest()
        square, turn = (int.from_bytes(part, "big") / 2**32 for part in (drawn[:4], drawn[4:]))
        return offset_ahead(2 * math.pi * turn, self._jitter * math.sqrt(square))

    def _counts_after_step(self, counts: tuple[int, ...], direction: int) -> tuple[int, ...]:
        sign = 1 if direction < _AXES else -1
        return tuple(n + sign * (k == direction % _AXES) for k, n in enumerate(counts))
