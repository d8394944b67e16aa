"""The ways of a graph that is being settled: which viewpoints and edges it has, and how far apart they leave two."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from nvsim.mapping.graph_builder import GraphBuilder

NEAR = 1.5  # metres; half of what R2R calls arrived
DETOUR = 1.5  # times as long, a way may become


class Ways:
    """Viewpoints of `draft` and edges between them; what is not among them stays out of account."""

    def __init__(self, draft: GraphBuilder) -> None:
        import networkx as nx

        self._draft, self._graph = draft, nx.Graph()

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._graph))

    def __contains__(self, id: str) -> bool:
        return id in self._graph

    def edges(self) -> list[tuple[str, str]]:
        return list(self._graph.edges)

    def around(self, id: str) -> list[tuple[str, float]]:
        """What edges lead to from a viewpoint, and their metres."""
        return [(other, data["weight"]) for other, data in self._graph[id].items()]

    def add(self, ids: Iterable[str]) -> None:
        self._graph.add_nodes_from(ids)

    def remove(self, id: str) -> None:
        self._graph.remove_node(id)

    def join(self, a: str, b: str) -> None:
        self._graph.add_edge(a, b, weight=self.apart(a, b))

    def cut(self, a: str, b: str) -> None:
        self._graph.remove_edge(a, b)

    def apart(self, a: str, b: str) -> float:
        """Metres straight, seen from above."""
        return math.dist(self._draft.viewpoints[a].position[:2], self._draft.viewpoints[b].position[:2])

    def metres(self, a: str, b: str, most: float = math.inf) -> float:
        """Of the shortest way from one viewpoint to another; infinite where it is longer than `most`."""
        import networkx as nx

        try:
            return float(nx.single_source_dijkstra(self._graph, a, b, cutoff=most)[0])
        except nx.NetworkXNoPath:
            return math.inf

    def all_metres(self, start: str, most: float) -> dict[str, float]:
        """id -> metres from `start`, of all that are no farther than `most`."""
        import networkx as nx

        return dict(nx.single_source_dijkstra_path_length(self._graph, start, cutoff=most))

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
