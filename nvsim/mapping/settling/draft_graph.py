"""The paths of a graph that is being settled: its viewpoints, its edges, and the distances between them. Edges are
removed so that the shortest path between two viewpoints is unique.

Agents are trained on the shortest path. If two paths are equally short, one of them is scored as wrong."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from heapq import heappop, heappush

from nvsim.graph.paths import SAME_LENGTH
from nvsim.mapping.search.graph_builder import GraphBuilder

NEAR = 1.5  # meters; half of R2R's success distance
DETOUR = 1.5  # maximum ratio by which a path may become longer
_ROUNDING = 1e-6  # meters, more than the rounding error of a path


class DraftGraph:
    """Viewpoints of `draft` and edges between them. Other viewpoints are ignored."""

    def __init__(self, draft: GraphBuilder) -> None:
        self._draft = draft
        self._joined: dict[str, dict[str, float]] = {}  # id -> id -> meters, in both directions

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._joined))

    def __contains__(self, id: str) -> bool:
        return id in self._joined

    def edges(self) -> list[tuple[str, str]]:
        """Return each edge once, in the order of the viewpoints and of their joins."""
        done: set[str] = set()
        found = []
        for id, joined in self._joined.items():
            found += [(id, other) for other in joined if other not in done]
            done.add(id)
        return found

    def around(self, id: str) -> list[tuple[str, float]]:
        """Return the neighbors of a viewpoint and their distances in meters."""
        return list(self._joined[id].items())

    def add(self, ids: Iterable[str]) -> None:
        for id in ids:
            self._joined.setdefault(id, {})

    def remove(self, id: str) -> None:
        for other in self._joined.pop(id):
            del self._joined[other][id]

    def join(self, a: str, b: str) -> None:
        self._joined[a][b] = self._joined[b][a] = self.distance(a, b)

    def remove_edge(self, a: str, b: str) -> None:
        del self._joined[a][b], self._joined[b][a]

    def distance(self, a: str, b: str) -> float:
        """Return the straight distance in meters, seen from above."""
        return math.dist(self._place(a), self._place(b))

    def _place(self, id: str) -> tuple[float, float]:
        return self._draft.viewpoints[id].position[:2]

    def meters(self, a: str, b: str, most: float = math.inf) -> float:
        """Return the length in meters of the shortest path from one viewpoint to another; infinite if it is longer than
        `most`."""
        return self.path_lengths_from(a, most, b).get(b, math.inf)

    def path_lengths_from(self, start: str, most: float, until: str | None = None) -> dict[str, float]:
        """Return id -> meters from `start`, the nearest first, for all viewpoints that are at most `most` away. With
        `until`, the search ends there, and viewpoints are skipped if a path over them must exceed `most`. Dijkstra's
        algorithm; networkx takes ten times as long for such short paths, which are most of the work of settling."""
        found: dict[str, float] = {}
        heap = [(0.0, start)]
        aside = until is not None and math.isfinite(most)
        end = self._place(until) if until is not None else (0.0, 0.0)
        while heap:
            meters, id = heappop(heap)
            if id in found:
                continue
            found[id] = meters
            if id == until:
                break
            for other, length in self._joined[id].items():
                far = meters + length
                if far > most or other in found:
                    continue
                # No path is shorter than the straight line, except for rounding.
                if aside and far + math.dist(self._place(other), end) > most + _ROUNDING:
                    continue
                heappush(heap, (far, other))
        return found

    def parts(self) -> dict[str, frozenset[str]]:
        """Return id -> the viewpoints that are connected with it, including itself."""
        found: dict[str, frozenset[str]] = {}
        for id in self._joined:
            if id not in found:
                part = frozenset(self.path_lengths_from(id, math.inf))
                found.update(dict.fromkeys(part, part))
        return found

    def is_redundant(self, id: str) -> bool:
        """Whether the neighbors of a viewpoint reach each other without it, without a long detour."""
        around = [other for other, _ in self.around(id)]
        most = {
            (a, b): DETOUR * (self.distance(a, id) + self.distance(id, b))
            for i, a in enumerate(around)
            for b in around[:i]
        }
        self.remove(id)
        spared = all(self.meters(a, b, limit) <= limit for (a, b), limit in most.items())
        self.add([id])
        for other in around:
            self.join(id, other)
        return spared

    def is_edge_redundant(self, a: str, b: str) -> bool:
        """Whether another path joins the ends of an edge without a long detour. For near viewpoints, it must also be
        short."""
        length = self.distance(a, b)
        most = min(DETOUR * length, 2 * NEAR if length < NEAR else math.inf)
        self.remove_edge(a, b)
        spared = self.meters(a, b, most) <= most
        self.join(a, b)
        return spared


_FAR = 12.0  # meters: maximum length of paths that part and meet again


def remove_ties(ways: DraftGraph) -> None:
    """Remove edges until, of two paths that part and meet again, one is shorter by a centimeter, as far as edges can be
    spared. Each removed edge is the last one of such a path, the longer edge first. Paths of up to 12 m are examined,
    from one viewpoint after the other."""
    waiting = set(ways)
    while waiting:  # a removed edge can cause new ties
        for start in sorted(ways):
            while start in waiting:
                touched = _remove_tie_from(ways, start)
                if touched:
                    waiting |= touched
                else:
                    waiting.remove(start)


def _remove_tie_from(ways: DraftGraph, start: str) -> set[str]:
    """Remove one edge, and return the viewpoints with paths within 12 m that may have used it. Returns an empty set if
    no paths from `start` are tied, or if no edge can be spared."""
    meters = ways.path_lengths_from(start, _FAR)
    for end in sorted(meters, key=lambda id: (meters[id], id)):
        last = _last(ways, meters, end)
        for before in last if len(last) > 1 else []:
            if ways.is_edge_redundant(before, end):
                touched = {id for side in (before, end) for id in ways.path_lengths_from(side, _FAR + SAME_LENGTH)}
                ways.remove_edge(before, end)
                return touched
    return set()


def _last(ways: DraftGraph, meters: dict[str, float], end: str) -> list[str]:
    """Return the viewpoints before `end` on paths from the start that are as short as the shortest, the farthest from
    `end` first."""
    edges = [(length, id) for id, length in ways.around(end) if meters.get(id, math.inf) < meters[end]]
    return [id for length, id in sorted(edges, reverse=True) if meters[id] + length <= meters[end] + SAME_LENGTH]
