"""Connected components of a graph, updated after each edit. After an edge is removed, the search starts from both ends
at once, so that the cost is that of the smaller side.

networkx cannot follow edits: a full count of 10,000 viewpoints takes it 60 ms after each. Here, a removed edge takes
less than 0.1 ms.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from nvsim.graph.findings.context import Finding, Fix
from nvsim.graph.types import EdgeKey, NavGraph

MANY = 64
"""If more elements than this are removed at once, everything is counted from scratch."""


class ConnectedGroups:
    """The connected groups of the included viewpoints. `begin` or `beginning` must be called first."""

    def begin(self, graph: NavGraph) -> None:
        """Count from scratch."""
        for _ in self.beginning(graph):
            pass

    def beginning(self, graph: NavGraph) -> Iterator[None]:
        """Count from scratch in short steps. The caller can do other work between them."""
        self._next = 0
        self._label: dict[str, int] = {}
        self._members: dict[int, set[str]] = {}
        self._large: set[int] = set()  # labels of groups with two or more viewpoints
        left_out = {id for id, viewpoint in graph.viewpoints.items() if not viewpoint.included}
        for id in graph.viewpoints:
            if id not in self._label and id not in left_out:
                reached = {id}
                yield from _flood_fill(reached, graph.adjacency, left_out)
                self._label_new_group(reached)

    def update(self, graph: NavGraph, viewpoints: Iterable[str], edges: Iterable[EdgeKey]) -> None:
        """Switch to a graph in which only these viewpoints and edges may differ."""
        edges = list(edges)
        changed = [id for id in viewpoints if (id in self._label) != self._is_in(graph, id)]
        lost = sum(key not in graph.edges for key in edges) + sum(id in self._label for id in changed)
        if lost > MANY:
            self.begin(graph)
            return
        cut: dict[str, None] = {}  # viewpoints that may have lost a path
        for id in changed:
            if id in self._label:
                self._take_out(id)
                cut.update(dict.fromkeys(graph.neighbors(id)))
            else:
                self._label_new_group({id})
        for key in edges:
            if key not in graph.edges:
                cut.update(dict.fromkeys(key))
        for id in changed:
            for other in graph.neighbors(id):
                if id in self._label and other in self._label:
                    self._join(id, other)
        for a, b in edges:
            if (a, b) in graph.edges and a in self._label and b in self._label:
                self._join(a, b)
        ends = [id for id in cut if id in self._label] if lost else []
        for label in {self._label[id] for id in ends}:
            self._part(graph, [id for id in ends if self._label[id] == label])

    def findings(self, graph: NavGraph) -> list[Finding]:
        """Return one finding for every group of two or more viewpoints except the largest. Among equally large groups,
        the one with the smallest id counts as the largest."""
        sizes = {label: len(self._members[label]) for label in self._large}
        most = max(sizes.values(), default=0)
        equals = [label for label, size in sizes.items() if size == most]
        # The smallest ids are only computed to break a tie.
        if len(equals) > 1:
            equals.sort(key=lambda label: min(self._members[label]))
        found = []
        for label in sizes.keys() - set(equals[:1]):
            ids = tuple(sorted(self._members[label]))
            message = f"{len(ids)} viewpoints around {graph.short(ids[0])} cannot be reached from the others."
            fixes = (Fix("Exclude them", "include", {"ids": list(ids), "included": False}),)
            found.append(Finding("island", "warning", message, ids, fixes=fixes))
        return found

    def _is_in(self, graph: NavGraph, id: str) -> bool:
        viewpoint = graph.viewpoints.get(id)
        return viewpoint is not None and viewpoint.included

    def _label_new_group(self, ids: set[str]) -> None:
        label, self._next = self._next, self._next + 1
        self._members[label] = ids
        self._label.update(dict.fromkeys(ids, label))
        self._sort_in(label)

    def _sort_in(self, label: int) -> None:
        size = len(self._members[label])
        if size > 1:
            self._large.add(label)
        else:
            self._large.discard(label)
        if size == 0:
            del self._members[label]

    def _take_out(self, id: str) -> None:
        label = self._label.pop(id)
        self._members[label].discard(id)
        self._sort_in(label)

    def _join(self, a: str, b: str) -> None:
        one, other = self._label[a], self._label[b]
        if one == other:
            return
        if len(self._members[one]) < len(self._members[other]):
            one, other = other, one
        for id in self._members[other]:
            self._label[id] = one
        self._members[one] |= self._members.pop(other)
        self._large.discard(other)
        self._sort_in(one)

    def _part(self, graph: NavGraph, ends: list[str]) -> None:
        """Split a group if `ends`, which are all viewpoints at its changes, do not reach each other."""
        while len(ends) > 1:
            side = _smaller_side(ends, graph)
            if side is None:
                return
            label = self._label[next(iter(side))]
            self._members[label] -= side
            self._sort_in(label)
            self._label_new_group(side)
            ends = [id for id in ends if id not in side]


def _smaller_side(ends: list[str], graph: NavGraph) -> set[str] | None:
    """Search from all `ends` in turn. Return the first region that is exhausted before it meets all others, or None if
    all are connected."""
    region = {id: n for n, id in enumerate(ends)}  # viewpoint -> region
    fronts: dict[int, list[str]] = {n: [id] for n, id in enumerate(ends)}
    while len(fronts) > 1:
        for n in list(fronts):
            if n not in fronts:
                continue
            if not fronts[n]:
                return {id for id, m in region.items() if m == n}
            id = fronts[n].pop()
            for other in graph.neighbors(id):
                if not graph.viewpoints[other].included:
                    continue
                m = region.get(other)
                if m is None:
                    region[other] = n
                    fronts[n].append(other)
                elif m != n:
                    # Two searches met: the smaller continues as part of the larger.
                    small, large = (n, m) if len(fronts[n]) < len(fronts[m]) else (m, n)
                    fronts[large] += fronts.pop(small)
                    for key, owner in region.items():
                        if owner == small:
                            region[key] = large
                    if small == n:
                        fronts[large].append(id)  # its other neighbors are not visited yet
                        break
            if len(fronts) == 1:
                return None
    return None


def _flood_fill(seen: set[str], adjacency: Mapping[str, tuple[str, ...]], left_out: set[str]) -> Iterator[None]:
    """Add all reachable viewpoints to `seen`, ring by ring, with fast set operations."""
    ring = seen.copy()
    while ring:
        ring = set().union(*(adjacency.get(id, ()) for id in ring)) - seen - left_out
        seen |= ring
        yield
