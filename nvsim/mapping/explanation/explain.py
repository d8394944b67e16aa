"""Explain why a corridor is open or not: every measured value with its limit and its part of the corridor."""

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
from nvsim.mapping.evidence.opinions import opinions


@dataclass(frozen=True)
class Measure:
    """The result of one criterion.

    decides  False if the rule does not use the criterion
    part     part of the corridor in which the value was found
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
        """Distance of the value to the limit, negative if it fails."""
        return self.limit - self.value if self.criterion.below else self.value - self.limit

    @property
    def relation(self) -> str:
        """The sign between the value and the limit."""
        return self.criterion.relation(self.passes)


@dataclass(frozen=True)
class Explanation:
    """The decision about a corridor, with its reasons.

    decision  "open", or the first criterion that fails: "alpha", "normal", "network-normal", "depth", "slice",
              "unknown"; "disputed" if it fails in only one of two models
    measures  all measured values, in the order in which criteria are tested
    corridor  the rows and cells that the robot needs
    obstacle  meters to the first row with an obstacle, None if there is none
    submap    the submap whose model was measured
    other     the explanation from the model of another submap, None if no other was used
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
        """The measure closest to its limit, of those that the rule uses."""
        return min((m for m in self.measures if m.decides), key=lambda m: abs(m.slack))

    @property
    def disagreement(self) -> str:
        """How the two models disagree, as the end of a sentence; "" if they agree, or if only one was used."""
        if self.other is None or (self.failed is None) == (self.other.failed is None):
            return ""
        return f"submap {self.submap} shows this, submap {self.other.submap} shows the corridor free"


def explain(evidence: Evidence, config: MappingConfig) -> Explanation:
    """Return the decision of `criteria.decide` with its reasons. With two models, these are the reasons of the model
    that refuses the corridor, or whose values are closest to their limits. Raises InputError if the evidence lacks the
    data of a criterion."""
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
    """Return the distance in meters to the first row that counts as filled, by the limits of rule worst, or otherwise
    by alpha of one half."""
    row, cell = (config.row_alpha, config.cell_alpha) if config.rule == "worst" else (0.5, 0.95)
    filled = np.flatnonzero((alpha.mean(axis=1) / 255 >= row) | (alpha.max(axis=1) / 255 >= cell))
    return None if len(filled) == 0 else evidence.near + float(filled[0]) * evidence.depth


def outline(evidence: Evidence, part: Part) -> NDArray[np.float64]:
    """Return (4, 2) world x, y in meters of the corners of a part of the corridor: near left, far left, far right, near
    right."""
    rows, cells = part
    each = evidence.width / evidence.alpha.shape[1]
    along = np.array([rows.start, rows.stop]) * evidence.depth + evidence.near
    across = np.array([cells.start, cells.stop]) * each - evidence.width / 2
    forward = np.array([np.sin(evidence.heading), np.cos(evidence.heading)])
    right = np.array([forward[1], -forward[0]])
    start = np.array(evidence.target) - evidence.length * forward
    corners = ((along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1]))
    return np.array([start + a * forward + b * right for a, b in corners])
