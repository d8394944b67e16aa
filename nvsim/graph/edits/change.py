"""Build a changed graph. This is the only place where edits add and remove elements, with the rules that all edits
follow.

Only mappings that change are copied. The indices of the original graph are updated with each change, so the cost of an
edit depends on the elements that it touches, not on the size of the graph.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

from nvsim.errors import UserError, value_text
from nvsim.graph.touched_elements import TouchedElements, remember
from nvsim.graph.types import Edge, EdgeKey, Evidence, EvidenceKey, NavGraph, Viewpoint

K = TypeVar("K")
V = TypeVar("V")
Place = tuple[float, float, float]


class EditError(UserError):
    """The edit is impossible on this graph. The message is one sentence with the reason."""


class Change:
    """A graph under construction, which starts as `graph`. Methods raise EditError if they would break a rule: the ends
    of edges exist, and locked elements do not change."""

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

    # Content ----------------------------------------------------------------------------------------------------

    def viewpoint(self, id: str) -> Viewpoint:
        """Return a viewpoint. Raises EditError if it does not exist."""
        found = self.viewpoints.get(id)
        if found is None:
            raise EditError(f"There is no viewpoint {id}.")
        return found

    def edge(self, a: str, b: str) -> Edge:
        """Return the edge between two viewpoints. Raises EditError if they are not joined."""
        found = self.edges.get(key_of(a, b))
        if found is None:
            raise EditError(f"The viewpoints {a} and {b} are not joined.")
        return found

    def neighbors(self, id: str) -> tuple[str, ...]:
        return (self.graph.adjacency if self._adjacency is None else self._adjacency).get(id, ())

    def evidence_keys(self, id: str) -> tuple[EvidenceKey, ...]:
        return (self.graph.evidence_of if self._evidence_of is None else self._evidence_of).get(id, ())

    # Viewpoints -------------------------------------------------------------------------------------------------

    def set_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Add a viewpoint at the end, or replace the one with its id. Raises EditError if it is locked, or if it would
        move and has a locked edge."""
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

    def remove_viewpoints(self, *ids: str) -> None:
        """Remove viewpoints with their edges and all evidence measured from them or toward them. Raises EditError if
        one does not exist, is locked, or has a locked edge."""
        gone = dict.fromkeys(ids)
        for id in gone:
            found = self.viewpoint(id)
            if found.locked:
                raise EditError(f"Viewpoint {id} is locked; unlock it first.")
        keys = dict.fromkeys(key_of(id, other) for id in gone for other in self.neighbors(id))
        for a, b in keys:
            if self.edges[a, b].locked:
                raise EditError(f"The edge from {a} to {b} is locked and holds its ends; unlock it first.")
        names = dict.fromkeys(name for id in gone for name in self.evidence_keys(id))
        if keys:
            edges, adjacency = self._own_edges(), self._own_adjacency()
            around = {end for key in keys for end in key if end not in gone}
            for key in keys:
                del edges[key]
            _remove_from_index(adjacency, gone, around, gone)
            self._touched_edges |= keys
        if names:
            evidence, index = self._own_evidence(), self._own_evidence_of()
            around = {end for name in names for end in _viewpoints_of_evidence(evidence[name]) if end not in gone}
            for name in names:
                del evidence[name]
            _remove_from_index(index, gone, around, names)
            self._touched_evidence |= names
        viewpoints = self._own_viewpoints()
        for id in gone:
            del viewpoints[id]
        self._touched_viewpoints |= gone

    def _need_loose(self, id: str, viewpoint: Viewpoint) -> None:
        if viewpoint.locked:
            raise EditError(f"Viewpoint {id} is locked; unlock it first.")
        for other in self.neighbors(id):
            if self.edges[key_of(id, other)].locked:
                raise EditError(f"The edge from {id} to {other} is locked and holds its ends; unlock it first.")

    # Edges ------------------------------------------------------------------------------------------------------

    def set_edge(self, edge: Edge) -> None:
        """Add an edge at the end, or replace the one with its ends. Raises EditError if an end does not exist, both
        ends are equal, or the edge is locked."""
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

    def remove_edge(self, a: str, b: str) -> None:
        """Remove an edge; its evidence stays. Raises EditError if it does not exist or is locked."""
        found = self.edge(a, b)
        if found.locked:
            raise EditError(f"The edge from {a} to {b} is locked; unlock it first.")
        adjacency = self._own_adjacency()
        for end, other in ((a, b), (b, a)):
            _remove_from_index(adjacency, (), (end,), (other,))
        del self._own_edges()[found.key]
        self._touched_edges[found.key] = None

    # Evidence and findings --------------------------------------------------------------------------------------

    def set_evidence(self, evidence: Evidence) -> None:
        """Add evidence, or replace the evidence with its key. Raises EditError if one of its viewpoints does not
        exist."""
        self.viewpoint(evidence.viewpoint)
        if evidence.joins:
            self.viewpoint(evidence.joins)
        before = self.evidence.get(evidence.key)
        if before is not None and before.joins != evidence.joins:
            _remove_from_index(self._own_evidence_of(), (), _viewpoints_of_evidence(before), (before.key,))
            before = None
        if before is None:
            index = self._own_evidence_of()
            for id in _viewpoints_of_evidence(evidence):
                index[id] = (*index.get(id, ()), evidence.key)
        self._own_evidence()[evidence.key] = evidence
        self._touched_evidence[evidence.key] = None

    def ignore(self, key: str, reason: str | None) -> None:
        """Store the reason why the finding `key` is ignored; None removes it."""
        left = {k: r for k, r in self._ignored.items() if k != key}
        self._ignored = left if reason is None else {**left, key: reason}

    # The result -------------------------------------------------------------------------------------------------

    def result(self) -> NavGraph:
        """Return the changed graph, or the original object if nothing changed."""
        parts = (self._viewpoints, self._edges, self._evidence)
        if all(part is None for part in parts) and self._ignored is self.graph.ignored:
            return self.graph
        after = NavGraph(self.graph.scan, self.viewpoints, self.edges, self.evidence, self._ignored)
        for name, own in (("adjacency", self._adjacency), ("evidence_of", self._evidence_of)):
            if own is not None:
                after.__dict__[name] = MappingProxyType(own)
            elif name in self.graph.__dict__:
                after.__dict__[name] = self.graph.__dict__[name]
        is_same = all((id in self.viewpoints) == (id in self.graph.viewpoints) for id in self._touched_viewpoints)
        if is_same and "short_length" in self.graph.__dict__:
            after.__dict__["short_length"] = self.graph.short_length
        touched = TouchedElements(
            tuple(self._touched_viewpoints), tuple(self._touched_edges), tuple(self._touched_evidence)
        )
        remember(after, self.graph, touched)
        return after

    # The first change makes copies. The proxies show the copy, so that NavGraph does not copy it again.

    def _own_viewpoints(self) -> dict[str, Viewpoint]:
        if self._viewpoints is None:
            self._viewpoints = copy_mapping(self.graph.viewpoints)
            self.viewpoints = MappingProxyType(self._viewpoints)
        return self._viewpoints

    def _own_edges(self) -> dict[EdgeKey, Edge]:
        if self._edges is None:
            self._edges = copy_mapping(self.graph.edges)
            self.edges = MappingProxyType(self._edges)
        return self._edges

    def _own_evidence(self) -> dict[EvidenceKey, Evidence]:
        if self._evidence is None:
            self._evidence = copy_mapping(self.graph.evidence)
            self.evidence = MappingProxyType(self._evidence)
        return self._evidence

    def _own_adjacency(self) -> dict[str, tuple[str, ...]]:
        if self._adjacency is None:
            self._adjacency = copy_mapping(self.graph.adjacency)
        return self._adjacency

    def _own_evidence_of(self) -> dict[str, tuple[EvidenceKey, ...]]:
        if self._evidence_of is None:
            self._evidence_of = copy_mapping(self.graph.evidence_of)
        return self._evidence_of


def _remove_from_index(
    index: dict[str, tuple[K, ...]], gone: Iterable[str], around: Iterable[str], without: Container[K]
) -> None:
    """Remove `gone` from an index, and the names `without` from the entries of `around`."""
    for id in gone:
        index.pop(id, None)
    for id in around:
        left = tuple(name for name in index[id] if name not in without)
        if left:
            index[id] = left
        else:
            del index[id]


def copy_mapping(mapping: Mapping[K, V]) -> dict[K, V]:
    """Return a new dict. The `copy` of a proxy copies the dict behind it, which is as fast as copying memory."""
    return mapping.copy() if isinstance(mapping, MappingProxyType) else dict(mapping)


def key_of(a: str, b: str) -> EdgeKey:
    """Return the key of the edge between two ids in either order."""
    return (a, b) if a < b else (b, a)


def unique(names: Iterable[K]) -> tuple[K, ...]:
    """Return each name once, in order."""
    return tuple(dict.fromkeys(names))


def need_place(position: Iterable[float]) -> Place:
    """Return a position of three finite numbers, meters. Raises EditError if it is invalid."""
    values = tuple(position)
    if len(values) != 3 or not all(isinstance(v, float | int) and _is_finite(v) for v in values):
        raise EditError(f"{value_text(values)} is not a position.")
    return float(values[0]), float(values[1]), float(values[2])


def need_number(value: float, what: str, *, positive: bool = False) -> float:
    """Return a finite number. Raises EditError, which begins with `what`, if it is not finite, or not positive where it
    must be."""
    if not _is_finite(value) or (positive and value <= 0):
        raise EditError(f"{what} cannot be {value_text(value)}.")
    return float(value)


def _viewpoints_of_evidence(evidence: Evidence) -> tuple[str, ...]:
    if evidence.joins and evidence.joins != evidence.viewpoint:
        return (evidence.viewpoint, evidence.joins)
    return (evidence.viewpoint,)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that is too large for a float
        return False
