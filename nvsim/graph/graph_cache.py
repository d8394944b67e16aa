"""The graph after every step of a history. Recent graphs are kept in memory. Older graphs are rebuilt from the first
graph and the deltas of the steps, so that a long history of a large graph does not fill the memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from nvsim.graph.difference import GraphDelta, apply_deltas, delta_between
from nvsim.graph.types import NavGraph

# Budget in bytes for mappings that steps do not share. A larger budget would also slow down Python's garbage collector.
_BUDGET = 64 << 20
_ENTRY = 100  # approximate bytes of a dict entry
_STRIDE = 32  # if a distant graph is rebuilt, the graph this many steps earlier is kept as well


class GraphCache:
    """Holds one graph per step, numbered from 0."""

    def __init__(self, graph: NavGraph, deltas: Iterable[GraphDelta] = (), budget: int = _BUDGET) -> None:
        self._deltas = [GraphDelta(), *deltas]  # [i] leads from the graph of step i - 1 to that of step i
        self._kept: dict[int, NavGraph] = {0: graph}  # in order of use, the most recent at the end
        self._bytes: dict[int, int] = {}
        self._budget = budget

    def __len__(self) -> int:
        return len(self._deltas)

    def __getitem__(self, index: int) -> NavGraph:
        """The graph after step `index`."""
        if not 0 <= index < len(self._deltas):
            raise IndexError(index)
        found = self._kept.get(index)
        if found is None:
            found = self._graph_at(index)
        elif index:
            self._kept[index] = self._kept.pop(index)
        return found

    def index_of(self, graph: NavGraph) -> int | None:
        """Return the last step with exactly this graph object. Returns None if there is none or if the graph was
        rebuilt."""
        return max((i for i, kept in self._kept.items() if kept is graph), default=None)

    def store_step(self, index: int, before: NavGraph, after: NavGraph) -> GraphDelta:
        """Store step `index`, which leads from `before`, the graph of the previous step, to `after`. Later steps are
        deleted. Returns the delta of the step."""
        delta = delta_between(before, after)
        del self._deltas[index:]
        self._deltas.append(delta)
        for later in [i for i in self._kept if i >= index]:
            del self._kept[later]
            self._bytes.pop(later, None)
        self._keep(index, before, after)
        return delta

    def _graph_at(self, index: int) -> NavGraph:
        start = max(i for i in self._kept if i < index)
        graph = self._kept[start]
        if index - start > 2 * _STRIDE:
            halfway = apply_deltas(graph, self._deltas[start + 1 : index - _STRIDE + 1])
            self._keep(index - _STRIDE, graph, halfway)
            start, graph = index - _STRIDE, halfway
        made = apply_deltas(graph, self._deltas[start + 1 : index + 1])
        self._keep(index, graph, made)
        return made

    def _keep(self, index: int, before: NavGraph, graph: NavGraph) -> None:
        self._kept[index] = graph
        self._bytes[index] = sum(_ENTRY * len(own) for own in _unshared_mappings(before, graph))
        used = sum(self._bytes.values())
        for oldest in [i for i in self._kept if i not in (0, index)]:
            if used <= self._budget:
                break
            used -= self._bytes.pop(oldest)
            del self._kept[oldest]


def _unshared_mappings(before: NavGraph, graph: NavGraph) -> list[Mapping[Any, Any]]:
    """Return the mappings of `graph` that it does not share with `before`."""
    mappings: list[Mapping[Any, Any]] = []
    for name in ("viewpoints", "edges", "evidence"):
        own = getattr(graph, name)
        if own is not getattr(before, name):
            mappings.append(own)
    return mappings
