"""Explain why a corridor is open or not, and why the stored evidence contradicts an edge.

For an edge that was not measured, the corridors that were measured from its ends often cover most of the floor
between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import Decision, EdgeKey, Evidence, NavGraph
from nvsim.mapping import criteria
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DEPTH, NEAR, WIDTH, Corridor
from nvsim.mapping.criteria import (
    CRITERIA,
    DECISIONS,
    DISPUTED,
    FULL,
    OPEN,
    corridor_of,
    decide,
    strictest_decision,
    unmeasured_families,
)
from nvsim.mapping.criterion import Criterion, Part, unmeasured_message
from nvsim.mapping.evidence.second_opinions import opinions
from nvsim.mapping.search.graph_builder import SAME


@dataclass(frozen=True)
class CriterionResult:
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
    measures: tuple[CriterionResult, ...]
    corridor: Part
    obstacle: float | None
    submap: int = -1
    other: Explanation | None = None

    @property
    def failed(self) -> CriterionResult | None:
        """The measure that decided; None for an open corridor."""
        return next((m for m in self.measures if m.decides and not m.passes), None)

    @property
    def closest_to_limit(self) -> CriterionResult:
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
    several = [_explain_criteria(one, config) for one in opinions(evidence, config)]
    if len(several) == 1:
        return several[0]
    decision = strictest_decision([one.decision for one in several])
    first, second = sorted(
        several, key=lambda one: (one.failed is None, one.closest_to_limit.slack if one.failed is None else 0)
    )
    return replace(first, decision=decision, other=second)


def _explain_criteria(evidence: Evidence, config: MappingConfig) -> Explanation:
    for family in unmeasured_families(evidence, config):
        raise InputError(unmeasured_message(family))
    corridor = corridor_of(evidence, config)
    measures = []
    for criterion in criteria.CRITERIA:
        if criterion.measured(evidence):
            value, part = criterion.measure(evidence, corridor)
            measures.append(CriterionResult(criterion, value, criterion.limit(config), criterion.is_used(config), part))
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


_FREE = {c.plane: 0 if c.below else FULL[c.plane] for c in CRITERIA}  # values of free floor in each plane
_BESIDE = math.radians(60.0)  # maximum angle of two headings; other corridors share only the floor under the camera


def closed_path_test(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], bool]:
    """Return (graph, pair of viewpoints) -> whether the path between the two is closed under `config`.

    Measured evidence along the path decides, or the detour of the trajectory. Without it, the cells of other corridors
    from either end decide, and floor that none of them covers counts as free. Returns False if nothing is known. Stale
    evidence is ignored.
    """

    def is_closed(graph: NavGraph, key: EdgeKey) -> bool:
        laid = (combined_corridor(graph, here, there) for here, there in (key, key[::-1]))
        along = evidence_along(graph, key)
        if any(e.decision == "around" for e in along):
            return True  # the reason is not in the planes of the evidence
        relevant = along or [found[0] for found in laid if found is not None]
        return any(decide(e, config) != OPEN for e in relevant if not unmeasured_families(e, config))

    return is_closed


def combined_corridor(graph: NavGraph, here: str, there: str) -> tuple[Evidence, float] | None:
    """Return the corridor from one viewpoint to the other, read from the corridors measured from the first, and the
    share of it that they cover, 0 to 1. Cells that none covers are free floor. Returns None if no corridor is near."""
    xy = np.array([graph.viewpoints[id].position[:2] for id in (here, there)])
    corridor = Corridor((float(xy[0, 0]), float(xy[0, 1])), (float(xy[1, 0]), float(xy[1, 1])))
    measured = [graph.evidence[k] for k in graph.evidence_of.get(here, ()) if k[0] == here]
    near = [e for e in measured if not e.stale and _heading_difference(e.heading, corridor.heading) < _BESIDE]
    if not near:
        return None
    # The nearest heading comes last, so that its cells win: it sees them from the direction of the corridor.
    near.sort(key=lambda e: -_heading_difference(e.heading, corridor.heading))
    cells = corridor.cells() - xy[0]
    planes: dict[str, Any] = {
        plane: np.full(cells.shape[:2], free, getattr(near[-1], plane).dtype)
        for plane, free in _FREE.items()
        if all(getattr(e, plane) is not None for e in near)
    }
    known = np.zeros(cells.shape[:2], bool)
    for e in near:
        forward = np.array([math.sin(e.heading), math.cos(e.heading)])
        row = np.floor((cells @ forward - e.near) / e.depth).astype(np.int64)
        across = cells @ np.array([forward[1], -forward[0]]) / e.width + 0.5
        column = np.floor(across * e.alpha.shape[1]).astype(np.int64)
        inside = (row >= 0) & (row < e.alpha.shape[0]) & (column >= 0) & (column < e.alpha.shape[1])
        known |= inside
        for plane, values in planes.items():
            values[inside] = getattr(e, plane)[row[inside], column[inside]]
    evidence = Evidence(
        here,
        near[-1].direction,
        corridor.heading,
        corridor.length,
        near=NEAR,
        depth=DEPTH,
        width=WIDTH,
        submap=near[-1].submap,
        target=corridor.target,
        joins=there,
        **planes,
    )
    return evidence, float(known.mean())


def _heading_difference(a: float, b: float) -> float:
    """Radians between two headings."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


def closed_edge_reason(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], str]:
    """Return (graph, edge) -> reason; "" if the evidence in both directions is open or missing. Evidence is ignored if
    it is stale because an end was moved, or if it lacks the data of a criterion."""

    def reason(graph: NavGraph, key: EdgeKey) -> str:
        for here, there in (key, key[::-1]):
            place = graph.viewpoints[there].position
            for evidence in map(graph.evidence.__getitem__, graph.evidence_of.get(here, ())):
                if not _leads_to(evidence, there, place) or evidence.viewpoint != here or evidence.stale:
                    continue
                if unmeasured_families(evidence, config):
                    continue
                decision = decide(evidence, config)
                if decision == DISPUTED:
                    return (
                        f"seen from {graph.short(here)}, {DECISIONS[decision].clause} ({_side_words(evidence, config)})"
                    )
                if decision != OPEN:
                    return f"seen from {graph.short(here)}, {DECISIONS[decision].clause}"
        return ""

    return reason


def _side_words(evidence: Evidence, config: MappingConfig) -> str:
    found = explain(evidence, config)
    clause = "" if found.failed is None else DECISIONS[found.failed.word].clause
    return f"{clause}: {found.disagreement}"


def smallest_margin(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], float]:
    """Return (graph, edge) -> smallest distance of the evidence to the thresholds that decide, over both directions and
    all models. Negative if a criterion fails, NaN if nothing was measured or all evidence is stale."""

    def margin(graph: NavGraph, key: EdgeKey) -> float:
        found = [explain(e, config) for e in evidence_along(graph, key) if not unmeasured_families(e, config)]
        shown = [one for first in found for one in (first, first.other) if one is not None]
        return min((m.slack for one in shown for m in one.measures if m.decides), default=float("nan"))

    return margin


def _leads_to(evidence: Evidence, id: str, place: tuple[float, float, float]) -> bool:
    """Whether the corridor ends at the viewpoint with this id and position."""
    if evidence.joins:
        return evidence.joins == id
    x, y = evidence.target
    return math.hypot(x - place[0], y - place[1]) < SAME
