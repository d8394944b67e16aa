"""Why a corridor is open or not: every measured value beside its limit, and the part of the corridor it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.types import Decision, Evidence
from nvsim.mapping import criteria
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import OPEN, corridor_of, lacking, stricter
from nvsim.mapping.criterion import Criterion, Part, unmeasured
from nvsim.mapping.opinions import opinions


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
    """decision  "open", or the first criterion that fails: "alpha", "normal", "network-normal", "depth", "slice",
              "unknown"; "disputed" where this fails in one of two models alone
    measures  in the order in which they are asked, of all that was measured
    corridor  the rows and cells that the robot needs
    obstacle  metres to the first row that something stands in, None where nothing does
    submap    whose model shows all this
    other     what the model of another submap shows, None where none was asked
    """

    decision: Decision
    measures: tuple[Measure, ...]
    corridor: Part
    obstacle: float | None
    submap: int = -1
    other: Explanation | None = None

    @property
    def failed(self) -> Measure | None:
        """The measure that decided; None for an open corridor."""
        return next((m for m in self.measures if m.decides and not m.passes), None)

    @property
    def tightest(self) -> Measure:
        """The measure nearest to its limit, of those that the rule asks about."""
        return min((m for m in self.measures if m.decides), key=lambda m: abs(m.slack))

    @property
    def disagreement(self) -> str:
        """Which model shows what, in words that end a sentence; "" where they agree, or one alone was asked."""
        if self.other is None or (self.failed is None) == (self.other.failed is None):
            return ""
        return f"submap {self.submap} shows it so, submap {self.other.submap} shows the corridor free"


def explain(evidence: Evidence, config: MappingConfig) -> Explanation:
    """The decision of `criteria.decide`, with its reasons: those of the model that speaks against the corridor, or
    whose values are nearest to their limits. Raises InputError where the evidence lacks what a criterion asks for."""
    several = [_explained(one, config) for one in opinions(evidence, config)]
    if len(several) == 1:
        return several[0]
    decision = stricter([one.decision for one in several])
    first, second = sorted(
        several, key=lambda one: (one.failed is None, one.tightest.slack if one.failed is None else 0)
    )
    return replace(first, decision=decision, other=second)


def _explained(evidence: Evidence, config: MappingConfig) -> Explanation:
    for family in lacking(evidence, config):
        raise InputError(unmeasured(family))
    corridor = corridor_of(evidence, config)
    measures = []
    for criterion in criteria.CRITERIA:
        if criterion.measured(evidence):
            value, part = criterion.measure(evidence, corridor)
            measures.append(Measure(criterion, value, criterion.limit(config), criterion.asked(config), part))
    failed = next((m for m in measures if m.decides and not m.passes), None)
    word = OPEN if failed is None else failed.word
    obstacle = _obstacle(evidence, evidence.alpha[corridor], config)
    return Explanation(word, tuple(measures), corridor, obstacle, evidence.submap)


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
