"""The evidence of all edges of a graph that is being edited: worked out once for each edge, and again only for those
that an edit touched. With eight corridors from every viewpoint, all of a large graph take a second."""

from __future__ import annotations

from collections.abc import Iterator

from nvsim.graph.quantities import clearness
from nvsim.graph.touched import touched_between
from nvsim.graph.types import EdgeKey, NavGraph

STRIDE = 64  # edges between two pauses of `fill`


class ClearnessCache:
    """The evidence of edges, as `quantities` defines it, in the graph that the cache last followed."""

    def __init__(self) -> None:
        self._graph: NavGraph | None = None
        self._values: dict[EdgeKey, float] = {}

    def follow(self, graph: NavGraph | None) -> None:
        """Takes the graph after an edit. Call it after each: what several edits touched is not always known."""
        before, self._graph = self._graph, graph
        if before is graph:
            return
        touched = None if before is None or graph is None else touched_between(before, graph)
        if touched is None or before is None or graph is None:
            self._values = {}
            return
        ids = {*touched.viewpoints, *(id for id, _ in touched.evidence)}
        for key in touched.evidence:
            ids.update(e.joins for e in (before.evidence.get(key), graph.evidence.get(key)) if e is not None)
        for key_of_edge in touched.edges:
            self._values.pop(key_of_edge, None)
        for id in ids:
            for other in {*before.neighbours(id), *graph.neighbours(id)}:
                self._values.pop((min(id, other), max(id, other)), None)

    def at(self, graph: NavGraph, key: EdgeKey) -> float:
        """1 where every corridor along the edge is clear, 0 where one is full, NaN without any. `graph` is the one that
        was followed; of another nothing is kept."""
        if graph is not self._graph:
            return clearness(graph, key)
        found = self._values.get(key)
        if found is None:
            found = self._values[key] = clearness(graph, key)
        return found

    def fill(self) -> Iterator[None]:
        """Works out what is missing, with a pause every few edges; stops when another graph is followed."""
        graph = self._graph
        if graph is None:
            return
        missing = [key for key in graph.edges if key not in self._values]
        for start in range(0, len(missing), STRIDE):
            if graph is not self._graph:
                return
            for key in missing[start : start + STRIDE]:
                self.at(graph, key)
            yield
