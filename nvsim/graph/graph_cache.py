"""The graph after every step of a history. Recent ones are kept as they are; older ones are made again from the first
graph and the deltas of the steps, so that a long history of a large graph does not fill the memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from nvsim.graph.delta import Delta, delta_between, folded
from nvsim.graph.types import NavGraph

# Bytes for mappings that steps do not share. More would not only cost memory: Python's collector walks through them.
_BUDGET = 64 << 20
_ENTRY = 100  # bytes of a dict's entry, near enough
_STRIDE = 32  # a graph that is made again for a step far back is kept this much earlier as well


class GraphCache:
    """One graph per step, numbered from 0."""

    def __init__(self, graph: NavGraph, deltas: Iterable[Delta] = (), budget: int = _BUDGET) -> None:
        self._deltas = [Delta(), *deltas]  # [i] leads from the graph of step i - 1 to that of step i
        self._kept: dict[int, NavGraph] = {0: graph}  # in the order of use, the last at the end
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
            found = self._made(index)
        elif index:
            self._kept[index] = self._kept.pop(index)
        return found

    def index_of(self, graph: NavGraph) -> int | None:
        """The last step with this very graph, None where there is none or it was made again since."""
        return max((i for i, kept in self._kept.items() if kept is graph), default=None)

    def put(self, index: int, before: NavGraph, after: NavGraph) -> Delta:
        """Step `index` leads from `before`, the graph of the step before it, to `after`; later steps are gone."""
        delta = delta_between(before, after)
        del self._deltas[index:]
        self._deltas.append(delta)
        for later in [i for i in self._kept if i >= index]:
            del self._kept[later]
            self._bytes.pop(later, None)
        self._keep(index, before, after)
        return delta

    def _made(self, index: int) -> NavGraph:
        start = max(i for i in self._kept if i < index)
        graph = self._kept[start]
        if index - start > 2 * _STRIDE:
            halfway = folded(graph, self._deltas[start + 1 : index - _STRIDE + 1])
            self._keep(index - _STRIDE, graph, halfway)
            start, graph = index - _STRIDE, halfway
        made = folded(graph, self._deltas[start + 1 : index + 1])
        self._keep(index, graph, made)
        return made

    def _keep(self, index: int, before: NavGraph, graph: NavGraph) -> None:
        self._kept[index] = graph
        self._bytes[index] = sum(_ENTRY * len(own) for own in _own(before, graph))
        used = sum(self._bytes.values())
        for oldest in [i for i in self._kept if i not in (0, index)]:
            if used <= self._budget:
                break
            used -= self._bytes.pop(oldest)
            del self._kept[oldest]


def _own(before: NavGraph, graph: NavGraph) -> list[Mapping[Any, Any]]:
    """The mappings that a graph does not share with the one before."""
    mappings: list[Mapping[Any, Any]] = []
    for name in ("viewpoints", "edges", "evidence"):
        own = getattr(graph, name)
        if own is not getattr(before, name):
            mappings.append(own)
    return mappings
