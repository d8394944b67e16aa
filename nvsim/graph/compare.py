"""Compare two graphs, for example an automatic and a curated one, and merge selected differences. Viewpoints are
matched by id first, then by position."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nvsim.graph import edits
from nvsim.graph.edits import Change, EditError
from nvsim.graph.edits.change import key_of
from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint

Kind = Literal[
    "viewpoint added", "viewpoint removed", "viewpoint moved", "viewpoint changed", "edge added", "edge removed"
]
KINDS: tuple[Kind, ...] = (
    "viewpoint added",
    "viewpoint removed",
    "viewpoint moved",
    "viewpoint changed",
    "edge added",
    "edge removed",
)
_MILLIMETER = 1e-3


@dataclass(frozen=True)
class Deviation:
    """One difference of graph `b` from graph `a`. Ids are those of `a`; added viewpoints have their id in `b`.

    kind             one of KINDS
    words            description in one sentence
    viewpoint, edge  the element that differs; only one of the two is set
    distance         meters that a viewpoint moved
    """

    kind: Kind
    words: str
    viewpoint: str = ""
    edge: EdgeKey | None = None
    distance: float = 0.0


@dataclass(frozen=True, eq=False)
class Comparison:
    """The matched viewpoints of two graphs and their differences.

    matched     id in a -> id in b
    by_place    ids of a that were matched by position and have another id in b
    deviations  differences in the order of KINDS
    """

    matched: Mapping[str, str]
    by_place: tuple[str, ...]
    deviations: tuple[Deviation, ...]

    def counts(self) -> dict[str, int]:
        """Return kind -> number of deviations, for all kinds."""
        return {kind: sum(d.kind == kind for d in self.deviations) for kind in KINDS}


def compare(a: NavGraph, b: NavGraph, tolerance: float = 0.3) -> Comparison:
    """Return the differences of `b` from `a`. Viewpoints without a common id are matched if each is the nearest of the
    other and they are at most `tolerance` meters apart."""
    matched = {id: id for id in a.viewpoints if id in b.viewpoints}
    by_place = _by_place(
        [v for id, v in a.viewpoints.items() if id not in matched],
        [v for id, v in b.viewpoints.items() if id not in matched],
        tolerance,
    )
    matched |= by_place
    found: list[Deviation] = []
    in_a = {other: id for id, other in matched.items()}
    for id in b.viewpoints:
        if id not in in_a:
            found.append(Deviation("viewpoint added", f"Viewpoint {id} is new.", id))
    for id in a.viewpoints:
        if id not in matched:
            found.append(Deviation("viewpoint removed", f"Viewpoint {id} was removed.", id))
    for id, other in matched.items():
        found += _compare_viewpoints(a.viewpoints[id], b.viewpoints[other])
    named = {key_of(in_a.get(x, x), in_a.get(y, y)) for x, y in b.edges}
    for key in sorted(named - a.edges.keys()):
        found.append(Deviation("edge added", f"{key[0]} and {key[1]} are joined by a new edge.", edge=key))
    for key in a.edges:
        if key not in named:
            found.append(Deviation("edge removed", f"{key[0]} and {key[1]} have lost their edge.", edge=key))
    order = {kind: i for i, kind in enumerate(KINDS)}
    return Comparison(matched, tuple(by_place), tuple(sorted(found, key=lambda d: order[d.kind])))


def merge(a: NavGraph, b: NavGraph, comparison: Comparison, chosen: Iterable[Deviation]) -> NavGraph:
    """Return `a` with the chosen differences of `b`. With all differences, it has the positions and edges of `b`. A new
    viewpoint brings the evidence measured from it.

    Raises EditError if a chosen edge needs a new viewpoint that is not chosen, or if an element is locked.
    """
    wanted: dict[Kind, list[Deviation]] = {kind: [] for kind in KINDS}
    for deviation in dict.fromkeys(chosen):
        wanted[deviation.kind].append(deviation)
    in_a = {other: id for id, other in comparison.matched.items()}
    graph = edits.remove_edges(a, [d.edge for d in wanted["edge removed"] if d.edge is not None])
    graph = edits.remove_viewpoints(graph, [d.viewpoint for d in wanted["viewpoint removed"]])
    moved = [d.viewpoint for d in wanted["viewpoint moved"]]
    graph = edits.move_viewpoints(graph, {id: b.viewpoints[comparison.matched[id]].position for id in moved})
    change = Change(graph)
    for d in wanted["viewpoint changed"]:
        other = b.viewpoints[comparison.matched[d.viewpoint]]
        held = change.viewpoint(d.viewpoint)
        change.set_viewpoint(replace(held, included=other.included, height=other.height))
    new = [d.viewpoint for d in wanted["viewpoint added"]]
    for id in new:
        change.set_viewpoint(b.viewpoints[id])
    for id in new:
        for key in b.evidence_of.get(id, ()):
            evidence = b.evidence[key]
            joins = in_a.get(evidence.joins, evidence.joins)
            if evidence.viewpoint == id and (not joins or joins in change.viewpoints):
                change.set_evidence(replace(evidence, joins=joins))
    edges = {key_of(in_a.get(x, x), in_a.get(y, y)): edge for (x, y), edge in b.edges.items()}
    for d in wanted["edge added"]:
        assert d.edge is not None
        for end in d.edge:
            if end not in change.viewpoints:
                raise EditError(
                    f"The edge between {d.edge[0]} and {d.edge[1]} needs viewpoint {end}; select it as well."
                )
        change.set_edge(replace(edges[d.edge], a=d.edge[0], b=d.edge[1]))
    return change.result()


def _compare_viewpoints(a: Viewpoint, b: Viewpoint) -> list[Deviation]:
    found = []
    distance = math.dist(a.position, b.position)
    if distance > _MILLIMETER:
        found.append(Deviation("viewpoint moved", f"Viewpoint {a.id} moved by {distance:.2f} m.", a.id, None, distance))
    words = []
    if a.included != b.included:
        words.append("is included in navigation" if b.included else "is excluded from navigation")
    if abs(a.height - b.height) > _MILLIMETER:
        words.append(f"has its camera {b.height:.2f} m above the floor, not {a.height:.2f} m")
    if words:
        found.append(Deviation("viewpoint changed", f"Viewpoint {a.id} {' and '.join(words)}.", a.id))
    return found


def _by_place(a: list[Viewpoint], b: list[Viewpoint], tolerance: float) -> dict[str, str]:
    if not a or not b:
        return {}
    from scipy.spatial import cKDTree

    here, there = (np.array([v.position for v in side]) for side in (a, b))
    distance, to_b = cKDTree(there).query(here)
    _, to_a = cKDTree(here).query(there)
    mutual = (to_a[to_b] == np.arange(len(a))) & (distance <= tolerance)
    return {a[i].id: b[to_b[i]].id for i in np.flatnonzero(mutual).tolist()}
