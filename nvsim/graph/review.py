"""The order in which a user reviews edges: the least certain first."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import EdgeKey, NavGraph

Margin = Callable[[NavGraph, EdgeKey], float]
"""How far the evidence along an edge is from the thresholds, at the least; below 0 it speaks against it, NaN: none."""


def distance(margin: float) -> str:
    """How far evidence is from the thresholds, for the user: 0.12, or "less than 0.01"."""
    return f"{abs(margin):.2f}" if abs(margin) >= 0.005 else "less than 0.01"


@dataclass(frozen=True)
class Doubt:
    """edge    its key
    margin  how far its evidence is from the thresholds; NaN where there is none
    why     words for the user
    """

    edge: EdgeKey
    margin: float
    why: str


class Review:
    """Orders the edges of a graph that is being edited. A margin is computed again only where evidence changed."""

    def __init__(self, margin: Margin | None = None) -> None:
        """Without `margin` no edge has evidence that could be judged."""
        self._margin = margin
        self._known: dict[EdgeKey, tuple[tuple[int, ...], float]] = {}

    def order(self, graph: NavGraph) -> list[Doubt]:
        """Edges between included viewpoints that nobody reviewed: first those that two submap models disagree about,
        then those that nothing was measured along (a user's before others, and the longest first), then by margin, the
        smallest first."""
        doubts = []
        for key, edge in graph.edges.items():
            a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
            if edge.reviewed or not (a.included and b.included):
                continue
            margin = self._margin_of(graph, key)
            if math.isnan(margin):
                length = math.dist(a.position, b.position)
                person = edge.origin == "person"
                why = f"{'a user joined them and ' if person else ''}nothing was measured along its {length:.1f} m"
                doubts.append(((0 if person else 1, -length), Doubt(key, margin, why)))
            elif any(e.decision == "disputed" for e in evidence_along(graph, key)):
                why = f"two submap models disagree about it, and one speaks against it by {distance(margin)}"
                doubts.append(((-1, margin), Doubt(key, margin, why)))
            else:
                sense = "speaks against it" if margin < 0 else "speaks for it"
                why = f"the evidence {sense}, by {distance(margin)}"
                doubts.append(((2, margin), Doubt(key, margin, why)))
        doubts.sort(key=lambda item: item[0])
        return [doubt for _, doubt in doubts]

    def next(self, graph: NavGraph, after: EdgeKey | None = None) -> Doubt | None:
        """The edge to look at after `after`, or the least certain one; None when all are reviewed."""
        order = self.order(graph)
        at = next((i + 1 for i, doubt in enumerate(order) if doubt.edge == after), 0)
        return order[at % len(order)] if order else None

    def _margin_of(self, graph: NavGraph, key: EdgeKey) -> float:
        if self._margin is None or not graph.evidence:
            return math.nan
        measured = tuple(map(id, evidence_along(graph, key)))
        known = self._known.get(key)
        if known is None or known[0] != measured:
            known = (measured, self._margin(graph, key) if measured else math.nan)
            self._known[key] = known
        return known[1]
