"""The order in which a user reviews edges: the least certain first."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import EdgeKey, Evidence, NavGraph

Margin = Callable[[NavGraph, EdgeKey], float]
"""The smallest distance of the evidence along an edge to the thresholds. Negative: the evidence contradicts the edge.
NaN: no evidence."""


def distance(margin: float) -> str:
    """Format the distance of evidence to the thresholds for users: 0.12, or "less than 0.01"."""
    return f"{abs(margin):.2f}" if abs(margin) >= 0.005 else "less than 0.01"


@dataclass(frozen=True)
class DoubtfulEdge:
    """An edge to review.

    edge    its key
    margin  distance of its evidence to the thresholds; NaN without evidence
    why     reason, for users
    """

    edge: EdgeKey
    margin: float
    why: str


def reviewable_edges(graph: NavGraph) -> list[EdgeKey]:
    """Return the keys of the edges between included viewpoints; only these are exported and reviewed."""
    included = {id for id, viewpoint in graph.viewpoints.items() if viewpoint.included}
    return [key for key in graph.edges if included.issuperset(key)]


class Review:
    """Orders the edges of a graph that is being edited. A margin is computed again only if the evidence changed."""

    def __init__(self, margin: Margin | None = None) -> None:
        """Without `margin`, edges are ordered as if they had no evidence."""
        self._margin = margin
        self._known: dict[EdgeKey, tuple[tuple[Evidence, ...], float]] = {}

    def order(self, graph: NavGraph) -> list[DoubtfulEdge]:
        """Return the edges between included viewpoints that are not reviewed, in this order:

        1. edges about which two submap models disagree, by margin
        2. edges without evidence: those of users first, then the longest
        3. all other edges by margin, the smallest first
        """
        doubts = []
        for key in reviewable_edges(graph):
            edge, a, b = graph.edges[key], graph.viewpoints[key[0]], graph.viewpoints[key[1]]
            if edge.reviewed:
                continue
            margin = self._margin_of(graph, key)
            if math.isnan(margin):
                length = math.dist(a.position, b.position)
                person = edge.origin == "person"
                why = f"{'a user joined them and ' if person else ''}nothing was measured along its {length:.1f} m"
                doubts.append(((0 if person else 1, -length), DoubtfulEdge(key, margin, why)))
            elif any(e.decision == "disputed" for e in evidence_along(graph, key)):
                why = f"two submap models disagree about it, and one contradicts it by {distance(margin)}"
                doubts.append(((-1, margin), DoubtfulEdge(key, margin, why)))
            else:
                sense = "contradicts it" if margin < 0 else "supports it"
                why = f"the evidence {sense} by {distance(margin)}"
                doubts.append(((2, margin), DoubtfulEdge(key, margin, why)))
        doubts.sort(key=lambda item: item[0])
        return [doubt for _, doubt in doubts]

    def _margin_of(self, graph: NavGraph, key: EdgeKey) -> float:
        if self._margin is None or not graph.evidence:
            return math.nan
        measured = tuple(evidence_along(graph, key))
        known = self._known.get(key)
        if known is None or tuple(map(id, known[0])) != tuple(map(id, measured)):
            known = (measured, self._margin(graph, key) if measured else math.nan)
            self._known[key] = known
        return known[1]
