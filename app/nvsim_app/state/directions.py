"""The directions of a viewpoint: target, measurements, and decision, as text for display; and why two viewpoints have
an edge or not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import EdgeKey, Evidence, NavGraph, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS
from nvsim.mapping.criteria import DECISIONS, DISPUTED, OPEN, unmeasured_families
from nvsim.mapping.explanation.explain import Explanation, explain, outline
from nvsim.mapping.explanation.path_explanation import PathExplanation, explain_path
from nvsim_app.look import lengths
from nvsim_app.look.plain_text import plain
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays

_HERE = 0.01  # meters; a step that ends this close to a viewpoint leads to it
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_LEAST = 6  # minimum number of characters of a shortened id
_SHORTEST = 0.12  # minimum drawn share of a corridor that is blocked at its start


@dataclass(frozen=True, eq=False)
class Direction:
    """One corridor from a viewpoint.

    evidence     the measurements
    explanation  the decision with the thresholds in use
    place        compass point
    neighbor     id of the viewpoint at its end, "" if there is none
    joined       whether there is an edge to that viewpoint
    floor        world z of the floor at its start and at its end, meters
    name         short name of the neighbor
    """

    evidence: Evidence
    explanation: Explanation
    place: str
    neighbor: str
    joined: bool
    floor: tuple[float, float]
    name: str = ""

    @property
    def key(self) -> tuple[str, int]:
        return self.evidence.key

    @property
    def lattice(self) -> bool:
        return self.evidence.direction < DIRECTIONS and not self.evidence.joins

    @property
    def open(self) -> bool:
        """Whether the corridor passes the thresholds."""
        return self.explanation.decision == OPEN

    def polygon(self) -> NDArray[np.float64]:
        """(4, 3) corners of the region of interest on the floor, meters, world."""
        return self._on_floor(outline(self.evidence, self.explanation.corridor))

    def failed_corners(self) -> NDArray[np.float64] | None:
        """(4, 3) corners of the row or cell that failed a threshold, meters, world. None if the corridor passes, or
        fails as a whole."""
        failed = self.explanation.failed
        if failed is None or failed.part == self.explanation.corridor:
            return None
        return self._on_floor(outline(self.evidence, failed.part))

    def _on_floor(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        e = self.evidence
        forward = np.array([math.sin(e.heading), math.cos(e.heading)])
        start = np.array(e.target) - e.length * forward
        share = np.clip((xy - start) @ forward / max(e.length, 1e-6), 0, 1)
        return np.column_stack([xy, self.floor[0] + share * (self.floor[1] - self.floor[0])])

    @property
    def outcome_label(self) -> str:
        """The decision as a short text for a list."""
        failed, obstacle = self.explanation.failed, self.explanation.obstacle
        if self.explanation.decision == DISPUTED:
            return DECISIONS[DISPUTED].label
        if failed is not None:
            where = f", {lengths.length(obstacle, 1)}" if failed.word == "alpha" and obstacle is not None else ""
            return DECISIONS[failed.word].label + where
        if self.joined:
            return f"edge, {lengths.length(self.evidence.length, 1)}"
        stored = DECISIONS.get(self.evidence.decision)
        # If the stored reason is a threshold that is now met, the edge is missing for another reason.
        return "free, no edge" if stored is None or self._by_threshold else stored.label

    @property
    def _by_threshold(self) -> bool:
        return self.evidence.decision in {DISPUTED, *(m.word for m in self.explanation.measures)}

    @property
    def passable(self) -> bool:
        """Whether there is an edge, or the measurements and decisions allow one."""
        return self.joined or (self.open and (self.evidence.decision in ("", OPEN) or self._by_threshold))

    @property
    def reach(self) -> float:
        """The free part of the corridor as a share of its length, 0 to 1."""
        failed, obstacle, e = self.explanation.failed, self.explanation.obstacle, self.evidence
        if self.passable or e.length <= 0 or failed is None:
            return 1.0
        meters = e.near + failed.part[0].start * e.depth if obstacle is None else obstacle
        return min(1.0, max(_SHORTEST, meters / e.length))

    @property
    def sentence(self) -> str:
        """A sentence with the decision and its reason."""
        explanation, e = self.explanation, self.evidence
        way = f"to the {self.place}" if not e.joins else f"to viewpoint {self.name} ({self.place})"
        failed = explanation.failed
        if failed is not None:
            words = f"{failed.name} {two_decimals(failed.value)}, threshold {two_decimals(failed.limit)}"
            if failed.word == "alpha" and explanation.obstacle is not None:
                words += f", obstacle at {lengths.length(explanation.obstacle, 1)}"
            else:
                words += f", {DECISIONS[failed.word].clause}"
            if explanation.disagreement:
                words += f"; {explanation.disagreement}"
            if self.joined:
                return f"An edge {way}, although a threshold is not met: {words}."
            return f"No edge {way}: {words}."
        near = explanation.closest_to_limit
        measured = f"{near.name} {two_decimals(near.value)}, threshold {two_decimals(near.limit)}"
        if self.joined:
            return f"An edge {way}, {lengths.length(e.length)}: all thresholds are met; the closest is {measured}."
        stored = DECISIONS.get(e.decision)
        reason = "" if stored is None or self._by_threshold else stored.clause
        if not reason and self.neighbor:
            reason = "the corridor passes, but the edge was removed or the thresholds are not applied yet"
        elif not reason and e.decision == OPEN and not e.joins:
            reason = "the step was free, and a viewpoint near its end was connected instead"
        return f"No edge {way}: {reason or 'the corridor passes, but there is no viewpoint at its end'} ({measured})."


def compass(heading: float) -> str:
    """The nearest of eight compass points; `heading` in radians, 0 is north (+y), clockwise."""
    return _POINTS[round(heading / (math.pi / 4)) % 8]


def two_decimals(value: float) -> str:
    """Formats a value with two decimals."""
    return f"{value:.2f}"


def directions(graph: NavGraph, arrays: GraphArrays, viewpoint: str, config: MappingConfig) -> tuple[Direction, ...]:
    """The corridors that were measured from `viewpoint`, decided with `config`: steps first, then corridors to other
    viewpoints, each clockwise from north.

    Stale evidence of a moved viewpoint, and evidence that `config` cannot decide, are omitted."""
    row = arrays.index.get(viewpoint)
    if row is None:
        return ()
    found = []
    for key in graph.evidence_of.get(viewpoint, ()):
        e = graph.evidence[key]
        if e.viewpoint != viewpoint or e.stale or not e.alpha.size or unmeasured_families(e, config):
            continue
        goal = _goal(arrays, e)
        neighbor = "" if goal is None else arrays.ids[goal]
        joined = bool(neighbor) and neighbor != viewpoint and edge(viewpoint, neighbor).key in graph.edges
        low = float(arrays.feet[row, 2])
        far = low if goal is None else float(arrays.feet[goal, 2])
        place = compass(e.heading % (2 * math.pi))
        name = plain(graph.short(neighbor or e.joins, _LEAST))
        found.append(Direction(e, explain(e, config), place, neighbor, joined, (low, far), name))
    return tuple(sorted(found, key=lambda d: (not d.lattice, d.evidence.heading % (2 * math.pi))))


def _goal(arrays: GraphArrays, e: Evidence) -> int | None:
    """The row of the viewpoint at the end of the corridor, None if there is none."""
    if e.joins:
        return arrays.index.get(e.joins)
    if not len(arrays.positions):
        return None
    distance = np.hypot(arrays.positions[:, 0] - e.target[0], arrays.positions[:, 1] - e.target[1])
    nearest = int(distance.argmin())
    return nearest if distance[nearest] < _HERE else None


def path_between(document: Document, a: str, b: str) -> PathExplanation | None:
    """The explanation for two viewpoints; None if they are equal or one does not exist. The occupancy map is used only
    if the building has one storey."""
    graph, contents = document.graph, document.contents
    if graph is None or a == b or not {a, b} <= graph.viewpoints.keys():
        return None
    occupancy = contents.occupancy if len(document.storeys.found) < 2 else None
    return explain_path(graph, a, b, contents.thresholds, occupancy)


def first_obstacle_on_edge(document: Document, key: EdgeKey) -> NDArray[np.float64] | None:
    """(3,) meters, world: the floor at the first known obstacle on the line of an edge; None if none is known."""
    found = path_between(document, *key)
    if found is None:
        return None
    arrays = document.graph_arrays
    start, end = (arrays.feet[arrays.index[id]] for id in key)
    if found.blocked is not None:
        along = found.blocked / max(float(np.linalg.norm((end - start)[:2])), 1e-9)
        return np.asarray(start + along * (end - start))
    for way in found.ways:
        explanation = way.found
        if explanation is not None and explanation.decision != OPEN and explanation.obstacle is not None:
            begin, goal = (arrays.feet[arrays.index[id]] for id in (way.start, way.end))
            along = min(explanation.obstacle / max(found.meters, 1e-9), 1.0)
            return np.asarray(begin + along * (goal - begin))
    return None
