"""A cache for the clearness of the edges of a graph that is being edited.

The value of an edge is computed once, and again only if an edit touched the edge. Computing all edges of a large graph
takes a second, because every viewpoint has eight corridors.
"""

from __future__ import annotations

from collections.abc import Iterator

from nvsim.graph.quantities import clearness
from nvsim.graph.touched_elements import elements_touched_between
from nvsim.graph.types import EdgeKey, NavGraph

STRIDE = 64  # edges that `fill` computes between two yields


class ClearnessCache:
    """Caches the clearness of edges (see `quantities.clearness`) for the graph of the last call of `update`."""

    def __init__(self) -> None:
        self._graph: NavGraph | None = None
        self._values: dict[EdgeKey, float] = {}

    def update(self, graph: NavGraph | None) -> None:
        """Switch to the graph after an edit and drop the values that the edit touched. Call this after every edit,
        because the changes of several edits together are not always known."""
        before, self._graph = self._graph, graph
        if before is graph:
            return
        touched = None if before is None or graph is None else elements_touched_between(before, graph)
        if touched is None or before is None or graph is None:
            self._values = {}
            return
        ids = {*touched.viewpoints, *(id for id, _ in touched.evidence)}
        for key in touched.evidence:
            ids.update(e.joins for e in (before.evidence.get(key), graph.evidence.get(key)) if e is not None)
        for key_of_edge in touched.edges:
            self._values.pop(key_of_edge, None)
        for id in ids:
            for other in {*before.neighbors(id), *graph.neighbors(id)}:
                self._values.pop((min(id, other), max(id, other)), None)

    def at(self, graph: NavGraph, key: EdgeKey) -> float:
        """Return the clearness of an edge: 1 if every corridor along it is clear, 0 if one is blocked, NaN without
        evidence. The value is cached only if `graph` is the graph of the last `update`."""
        if graph is not self._graph:
            return clearness(graph, key)
        found = self._values.get(key)
        if found is None:
            found = self._values[key] = clearness(graph, key)
        return found

    def fill(self) -> Iterator[None]:
        """Compute the missing values. Yields every STRIDE edges, and stops if `update` switches to another graph."""
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
