"""The graph during a build: viewpoints by position, edges by viewpoint, evidence by viewpoint and direction. The edits
of a user are kept when a graph is built again."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Edge, EdgeOrigin, Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping.corridor import DIRECTIONS

_BUCKET = 2.5  # meters
STEEPEST = 0.8  # maximum rise of stairs, meters per meter along the floor
SAME_FLOOR = 0.6  # maximum difference in height of cameras over one floor, meters
SAME = 0.01  # meters: positions this close are one position


class GraphBuilder:
    """The growing graph of a build.

    viewpoints  id -> viewpoint, in the order they were found
    evidence    id -> direction -> evidence
    """

    def __init__(self, scan: str, storey_of: Callable[[float], int] = lambda z: 0) -> None:
        """`storey_of` returns the storey of a camera at a world z."""
        self.scan, self._storey_of = scan, storey_of
        self.viewpoints: dict[str, Viewpoint] = {}
        self.evidence: dict[str, dict[int, Evidence]] = {}
        self._edges: dict[tuple[str, str], Edge] = {}
        self._joined: dict[str, set[str]] = {}
        self._buckets: dict[tuple[int, int], list[str]] = {}
        self._measured_to: dict[str, set[str]] = {}  # id -> viewpoints with evidence of corridors to it

    def set_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Add a viewpoint, or replace the one with its id, which must have an equal position."""
        if viewpoint.id not in self.viewpoints:
            self._buckets.setdefault(_bucket(viewpoint.position), []).append(viewpoint.id)
            self._joined[viewpoint.id] = set()
            self.evidence[viewpoint.id] = {}
        self.viewpoints[viewpoint.id] = viewpoint

    def remove(self, id: str) -> None:
        """Remove a viewpoint, its edges, and the evidence from it and of the corridors to it."""
        for other in self.joined(id):
            self.remove_edge(id, other)
        self._buckets[_bucket(self.viewpoints[id].position)].remove(id)
        del self.viewpoints[id], self.evidence[id], self._joined[id]
        for other in self._measured_to.pop(id, ()):
            found = self.evidence.get(other, {})
            for direction in [k for k, e in found.items() if e.joins == id]:
                del found[direction]

    def store_evidence(self, evidence: Evidence) -> None:
        """Store evidence. It replaces the evidence of its viewpoint and direction."""
        self.evidence[evidence.viewpoint][evidence.direction] = evidence
        if evidence.joins:
            self._measured_to.setdefault(evidence.joins, set()).add(evidence.viewpoint)

    def join(self, a: str, b: str, origin: EdgeOrigin) -> None:
        new = edge(a, b, origin)
        self._edges.setdefault(new.key, new)
        self._joined[a].add(b)
        self._joined[b].add(a)

    def remove_edge(self, a: str, b: str) -> None:
        del self._edges[min(a, b), max(a, b)]
        self._joined[a].discard(b)
        self._joined[b].discard(a)

    def edges(self) -> list[tuple[str, str]]:
        """The keys of all edges, in the order they were found."""
        return list(self._edges)

    def joined(self, id: str) -> list[str]:
        """Return the ids that have an edge with `id`, sorted."""
        return sorted(self._joined[id])

    def are_joined(self, a: str, b: str) -> bool:
        return b in self._joined[a]

    def viewpoints_near(self, place: NDArray[np.floating], reach: float) -> list[Viewpoint]:
        """Return the viewpoints within `reach` meters of a camera position (3,), seen from above, the nearest first.
        Viewpoints that are higher or lower than stairs can lead within that distance are excluded."""
        x, y, z = (float(value) for value in place)
        around = reach + SAME  # tolerance for rounding
        column, row = _bucket((x - around, y - around))
        last_column, last_row = _bucket((x + around, y + around))
        found = []
        for i in range(column, last_column + 1):
            for j in range(row, last_row + 1):
                for id in self._buckets.get((i, j), ()):
                    there = self.viewpoints[id].position
                    distance = math.hypot(there[0] - x, there[1] - y)
                    if distance <= reach and abs(there[2] - z) <= STEEPEST * distance + SAME_FLOOR:
                        found.append((round(distance, 6), id))
        return [self.viewpoints[id] for _, id in sorted(found)]

    def step_towards(self, viewpoint: Viewpoint, other: Viewpoint) -> Evidence | None:
        """Return the evidence of the step from `viewpoint` that ends exactly at `other`; None if there is none."""
        for k in range(DIRECTIONS):
            evidence = self.evidence[viewpoint.id].get(k)
            if evidence is not None and level_distance(other, evidence.target) < SAME:
                return evidence
        return None

    def number_towards(self, viewpoint: str, other: str) -> int:
        """Return the direction number of the corridor between two viewpoints, or the next free one from 8 on."""
        for k, evidence in self.evidence[viewpoint].items():
            if evidence.joins == other:
                return k
        return max([*self.evidence[viewpoint], DIRECTIONS - 1]) + 1

    def is_within(self, a: str, b: str, hops: int) -> bool:
        """Whether a path of at most `hops` edges leads from one viewpoint to another."""
        front, seen = {a}, {a}
        for _ in range(hops):
            front = {n for id in front for n in self._joined[id]} - seen
            seen |= front
        return b in seen

    def graph(self) -> NavGraph:
        """Return the graph as a value, with evidence in the order of viewpoints and directions."""
        evidence = {(id, k): self.evidence[id][k] for id in self.viewpoints for k in sorted(self.evidence[id])}
        return NavGraph(self.scan, self.viewpoints, self._edges, evidence)

    def id_at(self, place: NDArray[np.floating]) -> str:
        """Return an id of 32 hex digits from the scan, the position (3,) in millimeters, and its storey. It is equal in
        every run."""
        x, y = (round(float(value) * 1000) for value in place[:2])
        storey = self._storey_of(float(place[2]))
        name = f"{self.scan} {x} {y}" + (f" {storey}" if storey else "")
        return hashlib.blake2b(name.encode(), digest_size=16).hexdigest()


def level_distance(viewpoint: Viewpoint, xy: NDArray[np.floating] | tuple[float, float]) -> float:
    """Return the meters between a viewpoint and a position (2,), seen from above."""
    return math.hypot(viewpoint.position[0] - float(xy[0]), viewpoint.position[1] - float(xy[1]))


def _bucket(place: tuple[float, ...]) -> tuple[int, int]:
    return math.floor(place[0] / _BUCKET), math.floor(place[1] / _BUCKET)


def keep_edits(graph: NavGraph, previous: NavGraph | None) -> NavGraph:
    """Return `graph` with the viewpoints and edges of `previous` that a user made or locked; edges need both ends. The
    marks of unmoved viewpoints, the marks of edges, and ignored findings are kept as well."""
    if previous is None:
        return graph
    viewpoints, edges = dict(graph.viewpoints), dict(graph.edges)
    for id, was in previous.viewpoints.items():
        now = viewpoints.get(id)
        if now is None:
            if was.origin == "person" or was.locked:
                viewpoints[id] = was
        elif now.position == was.position and (was.reviewed or was.locked):
            viewpoints[id] = replace(now, reviewed=was.reviewed, locked=was.locked)
    for key, held in previous.edges.items():
        found = edges.get(key)
        if found is None:
            if (held.origin == "person" or held.locked) and all(end in viewpoints for end in key):
                edges[key] = held
        elif held.reviewed or held.locked:
            edges[key] = replace(found, reviewed=held.reviewed, locked=held.locked)
    return NavGraph(graph.scan, viewpoints, edges, graph.evidence, previous.ignored)
