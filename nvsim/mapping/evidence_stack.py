"""Evidence of a whole graph in one stack, summed up so that another decision is a few comparisons of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS
from nvsim.mapping.criteria import corridor_of, standing_limit, under

WORDS = ("open", "alpha", "normal", "unknown")  # what the codes of `EvidenceStack.decide` say
_KEPT = 4  # widths of corridors whose sums are kept


@dataclass(frozen=True, eq=False)
class _Sums:
    """Over the rows up to each row r, (n, R): alpha and up summed, the largest and smallest sum of a row, the largest
    cell, the fewest supported cells of a row. `cells` is the width of the corridor in cells."""

    cells: int
    alpha: NDArray[np.uint32]
    alpha_row: NDArray[np.uint16]
    alpha_cell: NDArray[np.uint8]
    up: NDArray[np.uint32]
    up_row: NDArray[np.uint16]
    support_row: NDArray[np.uint8]


class _Group:
    """Evidence of one cell size and width, rows padded to the longest; planes are (cells, n, R)."""

    def __init__(self, rows: list[int], evidence: Sequence[Evidence]) -> None:
        self.index = np.array(rows)
        self.sample = max(evidence, key=lambda e: len(e.alpha))
        longest, cells = self.sample.alpha.shape
        count = len(evidence)
        self.length = np.array([e.length for e in evidence])
        self.rows = np.array([len(e.alpha) for e in evidence])
        self._alpha = np.zeros((count, longest, cells), np.uint8)
        self._up = np.zeros((count, longest, cells), np.uint8)
        self._support = np.zeros((count, longest, cells), np.uint8)
        for i, e in enumerate(evidence):
            n = len(e.alpha)
            self._alpha[i, :n], self._up[i, :n], self._support[i, :n] = e.alpha, e.up, e.support
        # One plane for each cell across: sums over neighbouring cells become sums of planes.
        self._alpha, self._up, self._support = (
            np.ascontiguousarray(a.transpose(2, 0, 1)) for a in (self._alpha, self._up, self._support)
        )
        self._sums: dict[tuple[int, int], _Sums] = {}

    def codes(self, config: MappingConfig) -> NDArray[np.uint8]:
        """(n,) indices into WORDS, as criteria.decide says."""
        _, across = corridor_of(self.sample, config)
        sums = self._summed(across.start, across.stop)
        e = self.sample
        starts = e.near + (np.arange(sums.alpha.shape[1]) + 0.5) * e.depth - e.depth / 2
        used = np.searchsorted(starts, self.length + config.half_width - 1e-9, side="left")
        last = np.minimum(np.maximum(used, 1), self.rows) - 1
        at = (np.arange(len(last)), last)
        count = (last + 1) * sums.cells
        worst = config.rule == "worst"
        alpha = sums.alpha[at] / count / 255 >= config.tau_alpha
        normal = sums.up[at] / count / 255 <= config.tau_normal
        if worst:
            alpha |= sums.alpha_row[at] / sums.cells / 255 >= config.row_alpha
            alpha |= sums.alpha_cell[at] / 255 >= config.cell_alpha
            normal |= sums.up_row[at] / sums.cells / 255 <= config.row_normal
        unknown = sums.support_row[at] / sums.cells < config.support
        return np.where(alpha, 1, np.where(normal, 2, np.where(unknown, 3, 0))).astype(np.uint8)

    def beneath(self, config: MappingConfig) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """(n,) alpha * 255 and (n,) support, summed over the cells under the viewpoint, and how many cells that is."""
        rows, cells = np.nonzero(under(self.sample, config))
        alpha = np.zeros(len(self.index), np.int64)
        support = np.zeros(len(self.index), np.int64)
        for r, c in zip(rows, cells, strict=True):
            alpha += self._alpha[c, :, r]
            support += self._support[c, :, r]
        return alpha, support, len(rows)

    def _summed(self, first: int, end: int) -> _Sums:
        found = self._sums.get((first, end))
        if found is not None:
            return found
        if len(self._sums) >= _KEPT:
            del self._sums[next(iter(self._sums))]
        shape = self._alpha.shape[1:]
        alpha, up = np.zeros(shape, np.uint16), np.zeros(shape, np.uint16)
        support, cell = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        for c in range(first, end):
            alpha += self._alpha[c]
            up += self._up[c]
            support += self._support[c]
            np.maximum(cell, self._alpha[c], out=cell)
        made = self._sums[first, end] = _Sums(
            end - first,
            np.cumsum(alpha, axis=1, dtype=np.uint32),
            np.maximum.accumulate(alpha, axis=1),
            np.maximum.accumulate(cell, axis=1),
            np.cumsum(up, axis=1, dtype=np.uint32),
            np.minimum.accumulate(up, axis=1),
            np.minimum.accumulate(support, axis=1),
        )
        return made


class EvidenceStack:
    """`evidence` (E,) in the order of the graph; `viewpoint` (E,) the row of the viewpoint that each was measured from,
    of `count` viewpoints."""

    def __init__(self, evidence: Sequence[Evidence], viewpoint: NDArray[np.int64], count: int) -> None:
        self._viewpoint, self._count = viewpoint, count
        self._size = len(evidence)
        self._turn = np.array([e.direction < DIRECTIONS and not e.joins for e in evidence], bool)
        members: dict[tuple[object, ...], list[int]] = {}
        for i, e in enumerate(evidence):
            members.setdefault((e.alpha.shape[1], e.near, e.depth, e.width), []).append(i)
        self._groups = [_Group(rows, [evidence[i] for i in rows]) for rows in members.values()]

    def decide(self, config: MappingConfig) -> NDArray[np.uint8]:
        """(E,) indices into WORDS."""
        codes = np.zeros(self._size, np.uint8)
        for group in self._groups:
            codes[group.index] = group.codes(config)
        return codes

    def stands(self, config: MappingConfig) -> NDArray[np.bool_]:
        """(count,) whether one can stand at each viewpoint, as criteria.can_stand says of its eight directions; true
        where nothing was measured."""
        alpha, support, cells = (np.zeros(self._count) for _ in range(3))
        for group in self._groups:
            turn = self._turn[group.index]
            where = self._viewpoint[group.index][turn]
            total, supported, each = group.beneath(config)
            alpha += np.bincount(where, total[turn], self._count)
            support += np.bincount(where, supported[turn], self._count)
            cells += np.bincount(where, np.full(len(where), each), self._count)
        known = cells > 0
        many = np.maximum(cells, 1)
        free = (alpha / many / 255 < standing_limit(config)) & (support / many >= config.support)
        return np.asarray(free | ~known)
