"""The ways of a graph that is being settled: which viewpoints and edges it has, and how far apart they leave two."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from heapq import heappop, heappush

from nvsim.mapping.graph_builder import GraphBuilder

NEAR = 1.5  # metres; half of what R2R calls arrived
DETOUR = 1.5  # times as long, a way may become
_ROUNDING = 1e-6  # metres, more than the sum of a way is off


class Ways:
    """Viewpoints of `draft` and edges between them; what is not among them stays out of account."""

    def __init__(self, draft: GraphBuilder) -> None:
        self._draft = draft
        self._joined: dict[str, dict[str, float]] = {}  # id -> id -> metres, both ways

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._joined))

    def __contains__(self, id: str) -> bool:
        return id in self._joined

    def edges(self) -> list[tuple[str, str]]:
        """Each once, in the order of the viewpoints and of what they were joined to."""
        done: set[str] = set()
        found = []
        for id, joined in self._joined.items():
            found += [(id, other) for other in joined if other not in done]
            done.add(id)
        return found

    def around(self, id: str) -> list[tuple[str, float]]:
        """What edges lead to from a viewpoint, and their metres."""
        return list(self._joined[id].items())

    def add(self, ids: Iterable[str]) -> None:
        for id in ids:
            self._joined.setdefault(id, {})

    def remove(self, id: str) -> None:
        for other in self._joined.pop(id):
            del self._joined[other][id]

    def join(self, a: str, b: str) -> None:
        self._joined[a][b] = self._joined[b][a] = self.apart(a, b)

    def cut(self, a: str, b: str) -> None:
        del self._joined[a][b], self._joined[b][a]

    def apart(self, a: str, b: str) -> float:
        """Metres straight, seen from above."""
        return math.dist(self._place(a), self._place(b))

    def _place(self, id: str) -> tuple[float, float]:
        return self._draft.viewpoints[id].position[:2]

    def metres(self, a: str, b: str, most: float = math.inf) -> float:
        """Of the shortest way from one viewpoint to another; infinite where it is longer than `most`."""
        return self._spread(a, most, b).get(b, math.inf)

    def all_metres(self, start: str, most: float) -> dict[str, float]:
        """id -> metres from `start`, of all that are no farther than `most`."""
        return self._spread(start, most)

    def _spread(self, start: str, most: float, until: str | None = None) -> dict[str, float]:
        """id -> metres from `start`, the nearest first, of all that are no farther than `most`, or of those no farther
        than `until` and not so far aside that a way over them cannot be one of `most` metres. Dijkstra's algorithm; the
        one of networkx takes ten times as long for the short ways asked here, which is most of what settling is."""
        found: dict[str, float] = {}
        heap = [(0.0, start)]
        aside = until is not None and math.isfinite(most)
        end = self._place(until) if until is not None else (0.0, 0.0)
        while heap:
            metres, id = heappop(heap)
            if id in found:
                continue
            found[id] = metres
            if id == until:
                break
            for other, length in self._joined[id].items():
                far = metres + length
                if far > most or other in found:
                    continue
                # No way is shorter than straight, but for rounding.
                if aside and far + math.dist(self._place(other), end) > most + _ROUNDING:
                    continue
                heappush(heap, (far, other))
        return found

    def parts(self) -> dict[str, int]:
        """id -> how many viewpoints hang together with it, itself included."""
        found: dict[str, int] = {}
        for id in self._joined:
            if id not in found:
                part = self.all_metres(id, math.inf)
                found.update(dict.fromkeys(part, len(part)))
        return found

    def can_spare(self, id: str) -> bool:
        """Whether those around a viewpoint reach each other without it by no long detour."""
        around = [other for other, _ in self.around(id)]
        most = {
            (a, b): DETOUR * (self.apart(a, id) + self.apart(id, b)) for i, a in enumerate(around) for b in around[:i]
        }
        self.remove(id)
        spared = all(self.metres(a, b, limit) <= limit for (a, b), limit in most.items())
        self.add([id])
        for other in around:
            self.join(id, other)
        return spared

    def can_spare_edge(self, a: str, b: str) -> bool:
        """Whether another way joins its ends that is no long detour, nor too long for viewpoints that are near."""
        length = self.apart(a, b)
        most = min(DETOUR * length, 2 * NEAR if length < NEAR else math.inf)
        self.cut(a, b)
        spared = self.metres(a, b, most) <= most
        self.join(a, b)
        return spared
