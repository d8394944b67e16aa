"""A graph in the making: the one place where an edit puts and drops things, with the rules that every edit keeps.

Only the mappings that change are copied; the indices of the graph before are handed on with the change, so that an edit
costs what it touches and not what the graph holds.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

from nvsim.errors import Refusal, shown
from nvsim.graph.touched import Touched, remember
from nvsim.graph.types import Edge, EdgeKey, Evidence, EvidenceKey, NavGraph, Viewpoint

K = TypeVar("K")
V = TypeVar("V")
Place = tuple[float, float, float]


class EditError(Refusal):
    """The edit is impossible on this graph; the message is one sentence that says why."""


class Change:
    """Begins as `graph`. Every method raises EditError rather than break a rule: ends of edges exist, what is locked
    stays as it is."""

    def __init__(self, graph: NavGraph) -> None:
        self.graph = graph
        self.viewpoints = graph.viewpoints
        self.edges = graph.edges
        self.evidence = graph.evidence
        self._ignored = graph.ignored
        self._viewpoints: dict[str, Viewpoint] | None = None
        self._edges: dict[EdgeKey, Edge] | None = None
        self._evidence: dict[EvidenceKey, Evidence] | None = None
        self._adjacency: dict[str, tuple[str, ...]] | None = None
        self._evidence_of: dict[str, tuple[EvidenceKey, ...]] | None = None
        self._touched_viewpoints: dict[str, None] = {}
        self._touched_edges: dict[EdgeKey, None] = {}
        self._touched_evidence: dict[EvidenceKey, None] = {}

    # What is there ----------------------------------------------------------------------------------------------

    def viewpoint(self, id: str) -> Viewpoint:
        """Raises EditError when there is none."""
        found = self.viewpoints.get(id)
        if found is None:
            raise EditError(f"There is no viewpoint {id}.")
        return found

    def edge(self, a: str, b: str) -> Edge:
        """Raises EditError when the two are not joined."""
        found = self.edges.get(key_of(a, b))
        if found is None:
            raise EditError(f"The viewpoints {a} and {b} are not joined.")
        return found

    def neighbours(self, id: str) -> tuple[str, ...]:
        return (self.graph.adjacency if self._adjacency is None else self._adjacency).get(id, ())

    def evidence_keys(self, id: str) -> tuple[EvidenceKey, ...]:
        return (self.graph.evidence_of if self._evidence_of is None else self._evidence_of).get(id, ())

    # Viewpoints -------------------------------------------------------------------------------------------------

    def put(self, viewpoint: Viewpoint) -> None:
        """Adds a viewpoint at the end, or replaces the one of its id."""
        before = self.viewpoints.get(viewpoint.id)
        if before is not None:
            if before == viewpoint:
                return
            if before.locked and replace(viewpoint, locked=True, reviewed=before.reviewed) != before:
                raise EditError(f"Viewpoint {viewpoint.id} is locked; unlock it first.")
            if before.position != viewpoint.position:
                self._need_loose(viewpoint.id, before)
        self._own_viewpoints()[viewpoint.id] = viewpoint
        self._touched_viewpoints[viewpoint.id] = None

    def drop(self, *ids: str) -> None:
        """The viewpoints go, and with them their edges and all evidence measured from them or towards them."""
        gone = dict.fromkeys(ids)
        for id in gone:
            found = self.viewpoint(id)
            if found.locked:
                raise EditError(f"Viewpoint {id} is locked; unlock it first.")
        keys = dict.fromkeys(key_of(id, other) for id in gone for other in self.neighbours(id))
        for a, b in keys:
            if self.edges[a, b].locked:
                raise EditError(f"The edge from {a} to {b} is locked and holds its ends; unlock it first.")
        names = dict.fromkeys(name for id in gone for name in self.evidence_keys(id))
        if keys:
            edges, adjacency = self._own_edges(), self._own_adjacency()
            around = {end for key in keys for end in key if end not in gone}
            for key in keys:
                del edges[key]
            _thin(adjacency, gone, around, gone)
            self._touched_edges |= keys
        if names:
            evidence, index = self._own_evidence(), self._own_evidence_of()
            around = {end for name in names for end in _ends(evidence[name]) if end not in gone}
            for name in names:
                del evidence[name]
            _thin(index, gone, around, names)
            self._touched_evidence |= names
        viewpoints = self._own_viewpoints()
        for id in gone:
            del viewpoints[id]
        self._touched_viewpoints |= gone

    def _need_loose(self, id: str, viewpoint: Viewpoint) -> None:
        if viewpoint.locked:
            raise EditError(f"Viewpoint {id} is locked; unlock it first.")
        for other in self.neighbours(id):
            if self.edges[key_of(id, other)].locked:
                raise EditError(f"The edge from {id} to {other} is locked and holds its ends; unlock it first.")

    # Edges ------------------------------------------------------------------------------------------------------

    def put_edge(self, edge: Edge) -> None:
        """Adds an edge at the end, or replaces the one with its ends."""
        a, b = edge.key
        if a == b:
            raise EditError("A viewpoint cannot be joined to itself.")
        self.viewpoint(a)
        self.viewpoint(b)
        before = self.edges.get(edge.key)
        if before == edge:
            return
        if before is None:
            adjacency = self._own_adjacency()
            adjacency[a] = (*adjacency.get(a, ()), b)
            adjacency[b] = (*adjacency.get(b, ()), a)
        elif before.locked and replace(edge, locked=True, reviewed=before.reviewed) != before:
            raise EditError(f"The edge from {a} to {b} is locked; unlock it first.")
        self._own_edges()[edge.key] = edge
        self._touched_edges[edge.key] = None

    def drop_edge(self, a: str, b: str) -> None:
        """The edge goes; the evidence behind it stays."""
        found = self.edge(a, b)
        if found.locked:
            raise EditError(f"The edge from {a} to {b} is locked; unlock it first.")
        adjacency = self._own_adjacency()
        for end, other in ((a, b), (b, a)):
            left = tuple(id for id in adjacency[end] if id != other)
            if left:
                adjacency[end] = left
            else:
                del adjacency[end]
        del self._own_edges()[found.key]
        self._touched_edges[found.key] = None

    # Evidence and findings --------------------------------------------------------------------------------------

    def put_evidence(self, evidence: Evidence) -> None:
        self.viewpoint(evidence.viewpoint)
        if evidence.joins:
            self.viewpoint(evidence.joins)
        before = self.evidence.get(evidence.key)
        if before is not None and before.joins != evidence.joins:
            self._forget(before)
            before = None
        if before is None:
            index = self._own_evidence_of()
            for id in _ends(evidence):
                index[id] = (*index.get(id, ()), evidence.key)
        self._own_evidence()[evidence.key] = evidence
        self._touched_evidence[evidence.key] = None

    def drop_evidence(self, key: EvidenceKey) -> None:
        found = self.evidence.get(key)
        if found is None:
            return
        self._forget(found)
        del self._own_evidence()[key]
        self._touched_evidence[key] = None

    def _forget(self, evidence: Evidence) -> None:
        index = self._own_evidence_of()
        for id in _ends(evidence):
            left = tuple(key for key in index[id] if key != evidence.key)
            if left:
                index[id] = left
            else:
                del index[id]

    def ignore(self, key: str, reason: str | None) -> None:
        """Notes why the finding `key` is ignored; None removes the note."""
        left = {k: r for k, r in self._ignored.items() if k != key}
        self._ignored = left if reason is None else {**left, key: reason}

    # The result -------------------------------------------------------------------------------------------------

    def done(self) -> NavGraph:
        """The graph as changed; the very graph it began as when nothing changed."""
        parts = (self._viewpoints, self._edges, self._evidence)
        if all(part is None for part in parts) and self._ignored is self.graph.ignored:
            return self.graph
        after = NavGraph(self.graph.scan, self.viewpoints, self.edges, self.evidence, self._ignored)
        for name, own in (("adjacency", self._adjacency), ("evidence_of", self._evidence_of)):
            if own is not None:
                after.__dict__[name] = MappingProxyType(own)
            elif name in self.graph.__dict__:
                after.__dict__[name] = self.graph.__dict__[name]
        touched = Touched(tuple(self._touched_viewpoints), tuple(self._touched_edges), tuple(self._touched_evidence))
        remember(after, self.graph, touched)
        return after

    # Copies on the first change. The proxies show the copy and keep NavGraph from copying again.

    def _own_viewpoints(self) -> dict[str, Viewpoint]:
        if self._viewpoints is None:
            self._viewpoints = copied(self.graph.viewpoints)
            self.viewpoints = MappingProxyType(self._viewpoints)
        return self._viewpoints

    def _own_edges(self) -> dict[EdgeKey, Edge]:
        if self._edges is None:
            self._edges = copied(self.graph.edges)
            self.edges = MappingProxyType(self._edges)
        return self._edges

    def _own_evidence(self) -> dict[EvidenceKey, Evidence]:
        if self._evidence is None:
            self._evidence = copied(self.graph.evidence)
            self.evidence = MappingProxyType(self._evidence)
        return self._evidence

    def _own_adjacency(self) -> dict[str, tuple[str, ...]]:
        if self._adjacency is None:
            self._adjacency = copied(self.graph.adjacency)
        return self._adjacency

    def _own_evidence_of(self) -> dict[str, tuple[EvidenceKey, ...]]:
        if self._evidence_of is None:
            self._evidence_of = copied(self.graph.evidence_of)
        return self._evidence_of


def _thin(index: dict[str, tuple[K, ...]], gone: Iterable[str], around: Iterable[str], without: Container[K]) -> None:
    """Takes `gone` out of an index, and the names `without` out of the entries of those `around`."""
    for id in gone:
        index.pop(id, None)
    for id in around:
        left = tuple(name for name in index[id] if name not in without)
        if left:
            index[id] = left
        else:
            del index[id]


def copied(mapping: Mapping[K, V]) -> dict[K, V]:
    """A dict of its own; a proxy's own `copy` is that of the dict behind it, which is as fast as copying memory."""
    return mapping.copy() if isinstance(mapping, MappingProxyType) else dict(mapping)


def key_of(a: str, b: str) -> EdgeKey:
    """The key of the edge between two ids in either order."""
    return (a, b) if a < b else (b, a)


def unique(names: Iterable[K]) -> tuple[K, ...]:
    """Each once, in order."""
    return tuple(dict.fromkeys(names))


def need_place(position: Iterable[float]) -> Place:
    """Three finite metres. Raises EditError."""
    values = tuple(position)
    if len(values) != 3 or not all(isinstance(v, float | int) and _is_finite(v) for v in values):
        raise EditError(f"{shown(values)} is not a place.")
    return float(values[0]), float(values[1]), float(values[2])


def need_number(value: float, what: str, *, positive: bool = False) -> float:
    """A finite number. Raises EditError that begins with `what`."""
    if not _is_finite(value) or (positive and value <= 0):
        raise EditError(f"{what} cannot be {shown(value)}.")
    return float(value)


def _ends(evidence: Evidence) -> tuple[str, ...]:
    if evidence.joins and evidence.joins != evidence.viewpoint:
        return (evidence.viewpoint, evidence.joins)
    return (evidence.viewpoint,)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float can hold
        return False
