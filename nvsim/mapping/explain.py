"""Why a corridor is open or not: every measured value beside its limit, and the part of the corridor it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence
from nvsim.mapping import criteria
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import OPEN, Criterion, Part, corridor_of


@dataclass(frozen=True)
class Measure:
    """What one criterion found.

    decides  False for a criterion that the rule does not ask about
    part     where in the corridor the value was found
    """

    criterion: Criterion
    value: float
    limit: float
    decides: bool
    part: Part

    @property
    def name(self) -> str:
        return self.criterion.name

    @property
    def word(self) -> Decision:
        return self.criterion.word

    @property
    def passes(self) -> bool:
        return bool(self.criterion.passes(self.value, self.limit))

    @property
    def slack(self) -> float:
        """How far the value stays from the limit, negative where it fails."""
        return self.limit - self.value if self.criterion.below else self.value - self.limit

    @property
    def relation(self) -> str:
        """How the value lies to the limit, as a sign."""
        return self.criterion.relation(self.passes)


@dataclass(frozen=True)
class Explanation:
    """decision  "open", or the first criterion that fails: "alpha", "normal", "unknown"
    measures  in the order in which they are asked
    corridor  the rows and cells that the robot needs
    obstacle  metres to the first row that something stands in, None where nothing does
    """

    decision: Decision
    measures: tuple[Measure, ...]
    corridor: Part
    obstacle: float | None

    @property
    def failed(self) -> Measure | None:
        """The measure that decided; None for an open corridor."""
        return next((m for m in self.measures if m.decides and not m.passes), None)

    @property
    def tightest(self) -> Measure:
        """The measure nearest to its limit, of those that the rule asks about."""
        return min((m for m in self.measures if m.decides), key=lambda m: abs(m.slack))


def explain(evidence: Evidence, config: MappingConfig) -> Explanation:
    """The decision of `criteria.decide`, with its reasons."""
    corridor = corridor_of(evidence, config)
    measures = []
    for criterion in criteria.CRITERIA:
        value, part = criterion.measure(evidence, corridor)
        measures.append(Measure(criterion, value, criterion.limit(config), criterion.asked(config), part))
    failed = next((m for m in measures if m.decides and not m.passes), None)
    word = OPEN if failed is None else failed.word
    return Explanation(word, tuple(measures), corridor, _obstacle(evidence, evidence.alpha[corridor], config))


def _obstacle(evidence: Evidence, alpha: NDArray[np.uint8], config: MappingConfig) -> float | None:
    """Where the first row lies that the rule, or one that asks for a half, takes as filled."""
    row, cell = (config.row_alpha, config.cell_alpha) if config.rule == "worst" else (0.5, 0.95)
    filled = np.flatnonzero((alpha.mean(axis=1) / 255 >= row) | (alpha.max(axis=1) / 255 >= cell))
    return None if len(filled) == 0 else evidence.near + float(filled[0]) * evidence.depth


def outline(evidence: Evidence, part: Part) -> NDArray[np.float64]:
    """(4, 2) world x, y of the corners of a part of the corridor: near left, far left, far right, near right."""
    rows, cells = part
    each = evidence.width / evidence.alpha.shape[1]
    along = np.array([rows.start, rows.stop]) * evidence.depth + evidence.near
    across = np.array([cells.start, cells.stop]) * each - evidence.width / 2
    forward = np.array([np.sin(evidence.heading), np.cos(evidence.heading)])
    right = np.array([forward[1], -forward[0]])
    start = np.array(evidence.target) - evidence.length * forward
    corners = ((along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1]))
    return np.array([start + a * forward + b * right for a, b in corners])
