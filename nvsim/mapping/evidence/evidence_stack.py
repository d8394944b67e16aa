"""The evidence of a whole graph in stacked arrays of sums, so that another decision takes only a few array
comparisons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.types import Decision, Evidence
from nvsim.mapping import criteria
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS
from nvsim.mapping.criteria import DISPUTED, OPEN, cells_under_robot, corridor_of, standing_criteria
from nvsim.mapping.criterion import FULL, Criterion, unmeasured_message
from nvsim.mapping.evidence.second_opinions import opinions

_KEPT = 4  # maximum number of corridor widths whose sums are cached

_Kind = tuple[str, str, bool]  # plane, over, below: the measure that a criterion uses


def decision_names() -> tuple[Decision, ...]:
    """Return the decisions of the codes of `EvidenceStack.decide`. The first is OPEN."""
    return (OPEN, *dict.fromkeys(c.word for c in criteria.CRITERIA), DISPUTED)


@dataclass(frozen=True, eq=False)
class _CorridorSums:
    """Sums for a corridor that is `cells` cells wide. `of` has (n, R) values for each kind of measure, over the rows up
    to row r: the sum of all cells, the extreme sum of a row, or the extreme cell."""

    cells: int
    of: Mapping[_Kind, NDArray[Any]]


class _EvidenceGroup:
    """Evidence with equal cell size, width and planes. Rows are padded to the longest; planes are (cells, n, R)."""

    def __init__(self, rows: list[int], evidence: Sequence[Evidence]) -> None:
        self.index = np.array(rows)
        self.sample = max(evidence, key=lambda e: len(e.alpha))
        longest, cells = self.sample.alpha.shape
        count = len(evidence)
        self.length = np.array([e.length for e in evidence])
        self.rows = np.array([len(e.alpha) for e in evidence])
        self._planes: dict[str, NDArray[np.uint8]] = {}
        for plane in FULL:
            if getattr(self.sample, plane) is None:
                continue
            padded = np.zeros((count, longest, cells), np.uint8)
            for i, e in enumerate(evidence):
                padded[i, : len(e.alpha)] = getattr(e, plane)
            # One plane for each cell across: sums over neighboring cells become sums of planes.
            self._planes[plane] = np.ascontiguousarray(padded.transpose(2, 0, 1))
        self._sums: dict[tuple[int, int], _CorridorSums] = {}

    def codes(self, config: MappingConfig) -> NDArray[np.uint8]:
        """(n,) uint8 indices into `decision_names()`, equal to criteria.decide."""
        _, across = corridor_of(self.sample, config)
        sums = self._sum_cells(across.start, across.stop)
        e = self.sample
        starts = e.near + (np.arange(self._planes["alpha"].shape[2]) + 0.5) * e.depth - e.depth / 2
        used = np.searchsorted(starts, self.length + config.half_width - 1e-9, side="left")
        last = np.minimum(np.maximum(used, 1), self.rows) - 1
        at = (np.arange(len(last)), last)
        count = (last + 1) * sums.cells
        codes, code = np.zeros(len(last), np.uint8), decision_names().index
        for criterion in reversed(criteria.CRITERIA):  # the first that fails is written last
            if criterion.is_used(config):
                self._require_plane(criterion)
                cells = {"corridor": count, "row": sums.cells, "cell": 1}[criterion.over]
                value = sums.of[_kind(criterion)][at] / cells / FULL[criterion.plane]
                codes[~criterion.passes(value, criterion.limit(config))] = code(criterion.word)
        return codes

    def sums_under_viewpoint(self, plane: str, config: MappingConfig) -> tuple[NDArray[np.int64], int]:
        """(n,) sums of a plane over the cells under the viewpoint, and the number of these cells."""
        rows, cells = np.nonzero(cells_under_robot(self.sample, config))
        total = np.zeros(len(self.index), np.int64)
        for r, c in zip(rows, cells, strict=True):
            total += self._planes[plane][c, :, r]
        return total, len(rows)

    def _require_plane(self, criterion: Criterion) -> None:
        if criterion.plane not in self._planes:
            raise InputError(unmeasured_message(criterion.family))

    def _sum_cells(self, first: int, end: int) -> _CorridorSums:
        found = self._sums.get((first, end))
        if found is not None:
            return found
        if len(self._sums) >= _KEPT:
            del self._sums[next(iter(self._sums))]
        of: dict[_Kind, NDArray[Any]] = {}
        for plane, cells in self._planes.items():
            kinds = {_kind(c) for c in criteria.CRITERIA if c.plane == plane}
            row = cells[first:end].sum(axis=0, dtype=np.uint16) if any(k[1] != "cell" for k in kinds) else cells[first]
            for kind in kinds:
                _, over, below = kind
                if over == "corridor":
                    of[kind] = np.cumsum(row, axis=1, dtype=np.uint32)
                    continue
                extreme = np.maximum if below else np.minimum
                one = row if over == "row" else extreme.reduce(cells[first:end], axis=0)
                of[kind] = extreme.accumulate(one, axis=1)
        made = self._sums[first, end] = _CorridorSums(end - first, of)
        return made


def _kind(criterion: Criterion) -> _Kind:
    return criterion.plane, criterion.over, criterion.below


class EvidenceStack:
    """Decides all evidence of a graph at once. `evidence` (E,) is in the order of the graph. `viewpoint` (E,) is the
    row of the viewpoint that each was measured from, of `count` viewpoints."""

    def __init__(self, evidence: Sequence[Evidence], viewpoint: NDArray[np.int64], count: int) -> None:
        asked = MappingConfig(second_opinion=True)
        self._doubled = np.array([i for i, e in enumerate(evidence) if e.second is not None], np.int64)
        self._first = _ModelMeasurements(evidence, viewpoint, count)
        others = [opinions(evidence[i], asked)[1] for i in self._doubled]
        self._second = _ModelMeasurements(others, viewpoint[self._doubled], count) if others else None

    def decide(self, config: MappingConfig) -> NDArray[np.uint8]:
        """Return (E,) uint8 indices into `decision_names()`. Raises InputError if evidence lacks a criterion."""
        codes = self._first.decide(config)
        if self._second is None or not config.second_opinion:
            return codes
        first = codes[self._doubled]
        differ = (first == 0) != (self._second.decide(config) == 0)
        codes[self._doubled] = np.where(differ, decision_names().index(DISPUTED), first)
        return codes

    def can_stand(self, config: MappingConfig) -> NDArray[np.bool_]:
        """Return (count,) bool: whether the robot can stand at each viewpoint, equal to criteria.can_stand of its eight
        directions. True without measurements."""
        stands = self._first.can_stand(config)
        return stands if self._second is None or not config.second_opinion else stands & self._second.can_stand(config)


class _ModelMeasurements:
    """The measurements of one model in each corridor."""

    def __init__(self, evidence: Sequence[Evidence], viewpoint: NDArray[np.int64], count: int) -> None:
        self._viewpoint, self._count = viewpoint, count
        self._size = len(evidence)
        self._turn = np.array([e.direction < DIRECTIONS and not e.joins for e in evidence], bool)
        members: dict[tuple[object, ...], list[int]] = {}
        for i, e in enumerate(evidence):
            held = tuple(plane for plane in FULL if getattr(e, plane) is not None)
            members.setdefault((e.alpha.shape[1], e.near, e.depth, e.width, held), []).append(i)
        self._groups = [_EvidenceGroup(rows, [evidence[i] for i in rows]) for rows in members.values()]

    def decide(self, config: MappingConfig) -> NDArray[np.uint8]:
        codes = np.zeros(self._size, np.uint8)
        for group in self._groups:
            codes[group.index] = group.codes(config)
        return codes

    def can_stand(self, config: MappingConfig) -> NDArray[np.bool_]:
        support, cells = self._sums_under_viewpoints("support", config)
        free = support / np.maximum(cells, 1) >= config.support
        for criterion in standing_criteria(config):
            total, cells = self._sums_under_viewpoints(criterion.plane, config)
            mean = total / np.maximum(cells, 1) / FULL[criterion.plane]
            free &= criterion.passes(mean, criterion.limit(config))
        return np.asarray(free | (cells == 0))

    def _sums_under_viewpoints(
        self, plane: str, config: MappingConfig
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(count,) sums of a plane over the cells under each viewpoint, and (count,) numbers of these cells."""
        totals, cells = np.zeros(self._count), np.zeros(self._count)
        for group in self._groups:
            turn = self._turn[group.index]
            where = self._viewpoint[group.index][turn]
            total, each = group.sums_under_viewpoint(plane, config)
            totals += np.bincount(where, total[turn], self._count)
            cells += np.bincount(where, np.full(len(where), each), self._count)
        return totals, cells
