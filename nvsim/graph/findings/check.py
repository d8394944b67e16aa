"""The findings of a graph, computed from scratch or updated after each edit. Both must give equal results.

Detours are near viewpoints with a long path between them in the graph. An agent one meter from its goal would then have
to take a long path.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import is_not
from types import MappingProxyType

import numpy as np

from nvsim.errors import InputError
from nvsim.graph.connectivity import check_scan_id
from nvsim.graph.difference import Difference, difference
from nvsim.graph.edits.change import key_of
from nvsim.graph.findings.context import SEVERITIES, Context, Finding, Fix, Limits
from nvsim.graph.findings.elements import Neighborhood, about_edge, about_pair, about_viewpoint, is_steep
from nvsim.graph.findings.groups import ConnectedGroups
from nvsim.graph.paths import components
from nvsim.graph.touched_elements import elements_touched_between
from nvsim.graph.types import EdgeKey, NavGraph

_NOTHING = Context()
_LEVEL = 0.5  # maximum height difference of two floors in meters; more indicates a railing, stairs or another storey


def check_graph(graph: NavGraph, context: Context = _NOTHING) -> list[Finding]:
    """Return all findings, the most severe first, otherwise in the order of the graph. Findings that a user ignores are
    included."""
    found = about_graph(graph)
    for viewpoint in graph.viewpoints.values():
        found += about_viewpoint(graph, viewpoint, context)
    groups = [group for group in components(graph) if len(group) > 1]
    groups.sort(key=lambda group: (-len(group), min(group)))
    for group in groups[1:]:
        ids = tuple(sorted(group))
        message = f"{len(ids)} viewpoints around {graph.short(ids[0])} cannot be reached from the others."
        fixes = (Fix("Exclude them", "include", {"ids": list(ids), "included": False}),)
        found.append(Finding("island", "warning", message, ids, fixes=fixes))
    places, beside = Neighborhood(context.limits.near), Neighborhood(context.limits.neighbors)
    for viewpoint in graph.viewpoints.values():
        places.set_viewpoint(viewpoint)
        beside.set_viewpoint(viewpoint)
        found += [
            about_pair(graph, viewpoint, graph.viewpoints[other]) for other in places.close_viewpoints(viewpoint.id)
        ]
        for other in beside.close_viewpoints(viewpoint.id):
            found += about_detour(graph, key_of(viewpoint.id, other), context)
    for key in graph.edges:
        found += about_edge(graph, key, context)
    return sorted(found, key=lambda f: SEVERITIES.index(f.severity))


def about_graph(graph: NavGraph) -> list[Finding]:
    """Return the findings about the graph as a whole that need no search."""
    found = []
    try:
        check_scan_id(graph.scan)
    except InputError as error:
        found.append(Finding("scan", "error", str(error)))
    if not any(v.included for v in graph.viewpoints.values()):
        found.append(Finding("empty", "error", "No viewpoint is included: agents cannot stand anywhere."))
    return found


_GRAPH, _GROUPS = "graph", "groups"
_Place = str | EdgeKey | tuple[str, str, str]


class Validator:
    """Updates findings after an edit: only the elements that it touched, and those near them, are checked again. The
    findings equal those of `check_graph`, in no particular order, including findings that a user ignores."""

    def __init__(self, graph: NavGraph | None = None, context: Context | None = None) -> None:
        """Without a graph, `begin` must be called first."""
        if graph is not None:
            self.begin(graph, context)

    def begin(self, graph: NavGraph, context: Context | None = None) -> None:
        """Check everything."""
        for _ in self.beginning(graph, context):
            pass

    def beginning(self, graph: NavGraph, context: Context | None = None) -> Iterator[None]:
        """Check everything in steps of well under a millisecond. The caller can do other work between them. The
        findings are complete when the iterator ends."""
        self._context = Context() if context is None else context
        self._graph = graph
        self._at: dict[_Place, tuple[Finding, ...]] = {}  # location -> findings; never empty
        self._along: dict[EdgeKey, tuple[tuple[object, ...], tuple[Finding, ...]]] = {}  # inputs -> findings
        self._all: dict[str, Finding] = {}
        self._before: dict[str, Finding | None] = {}  # key of a touched finding -> its previous value
        self._twins: dict[str, set[str]] = {}  # viewpoint -> viewpoints almost at its position
        limits = self._context.limits
        self._places, self._detours = Neighborhood(max(limits.near, influence_radius(limits))), DetourFindings()
        for viewpoint in graph.viewpoints.values():
            self._places.set_viewpoint(viewpoint)
            yield
        self._groups = ConnectedGroups()
        yield from self._groups.beginning(graph)
        for id in graph.viewpoints:
            self._look_at(id)
            yield
        for key in graph.edges:
            self._look_along(key)
            yield
        for viewpoint in graph.viewpoints.values():
            self._look_around([viewpoint.id], [viewpoint.id])
            yield
        self._replace_findings(_GROUPS, self._groups.findings(self._graph))
        self._replace_findings(_GRAPH, about_graph(graph))

    @property
    def findings(self) -> Mapping[str, Finding]:
        """Key -> finding."""
        return MappingProxyType(self._all)

    def update(self, graph: NavGraph, changed: Difference | None = None) -> tuple[set[str], set[str]]:
        """Switch to the graph after an edit. `changed` is its difference from the previous graph, if it is known
        already. Returns the keys of new and changed findings, and the keys of removed ones."""
        changed = difference(self._graph, graph) if changed is None else changed
        measured = _measured_anew(self._graph, graph)
        self._graph, self._before = graph, {}
        viewpoints = {*changed.added_viewpoints, *changed.removed_viewpoints, *changed.changed_viewpoints}
        edges = {*changed.added_edges, *changed.removed_edges, *changed.changed_edges}
        beside = set(viewpoints).union(*edges)
        for id in viewpoints:
            beside.update(graph.neighbors(id))
        for id in viewpoints | measured:
            edges.update((id, other) if id < other else (other, id) for other in graph.neighbors(id))
        # The finding about a steep edge also depends on the edges at its ends.
        for id in beside:
            if id in graph.viewpoints:
                keys = ((id, other) if id < other else (other, id) for other in graph.neighbors(id))
                edges.update(key for key in keys if is_steep(graph, key, self._context))
        around = self._places.around(viewpoints)
        for id in viewpoints:
            if id in graph.viewpoints:
                self._places.set_viewpoint(graph.viewpoints[id])
            else:
                self._places.remove_viewpoint(id)
        around |= self._places.around(viewpoints.union(measured, *edges))
        self._look_around(viewpoints, around)
        for id in beside:
            self._look_at(id)
        for key in edges:
            self._look_along(key)
        if viewpoints or edges:
            self._groups.update(graph, viewpoints, edges)
            self._replace_findings(_GROUPS, self._groups.findings(self._graph))
        self._replace_findings(_GRAPH, about_graph(graph))
        came = {key for key, old in self._before.items() if key in self._all and self._all[key] != old}
        return came, {key for key, old in self._before.items() if old is not None and key not in self._all}

    def _look_at(self, id: str) -> None:
        viewpoint = self._graph.viewpoints.get(id)
        self._replace_findings(id, [] if viewpoint is None else about_viewpoint(self._graph, viewpoint, self._context))

    def _look_along(self, key: EdgeKey) -> None:
        graph, found = self._graph, self._graph.edges.get(key)
        if found is None:
            self._replace_findings(key, ())
            return
        seen: tuple[object, ...] = (found, graph.viewpoints[key[0]], graph.viewpoints[key[1]])
        if self._context.against is not None:
            for id in key:
                seen += tuple(map(graph.evidence.__getitem__, graph.evidence_of.get(id, ())))
        if is_steep(graph, key, self._context):
            seen += tuple(graph.viewpoints[other] for id in key for other in graph.neighbors(id))
        known = self._along.get(key)
        # An undo restores identical objects.
        if known is None or len(known[0]) != len(seen) or any(map(is_not, known[0], seen)):
            known = self._along[key] = (seen, tuple(about_edge(graph, key, self._context)))
        self._replace_findings(key, known[1])

    def _look_around(self, changed: Iterable[str], around: Iterable[str]) -> None:
        """Check positions near the changed viewpoints, and the paths between all viewpoints around them."""
        near = {id: self._places.close_viewpoints(id) for id in around}
        for id in changed:
            self._look_for_twins(id, near[id])
        for key, found in self._detours.update(self._graph, near, self._context).items():
            self._replace_findings(("detour", *key), found)

    def _look_for_twins(self, id: str, near: Sequence[str]) -> None:
        viewpoints, limit = self._graph.viewpoints, self._context.limits.near
        twins = [o for o in near if math.dist(viewpoints[o].position, viewpoints[id].position) < limit]
        for other in self._twins.get(id, set()).difference(twins):
            self._replace_findings(_pair(id, other), [])
            self._twins[id].discard(other)
            self._twins[other].discard(id)
        for other in twins:
            self._replace_findings(_pair(id, other), [about_pair(self._graph, viewpoints[id], viewpoints[other])])
            self._twins.setdefault(id, set()).add(other)
            self._twins.setdefault(other, set()).add(id)

    def _replace_findings(self, place: _Place, found: Sequence[Finding]) -> None:
        before = self._at.get(place, ())
        if not (before or found) or before == tuple(found):
            return
        for finding in before:
            self._before.setdefault(finding.key, self._all.pop(finding.key, None))
        if found:
            self._at[place] = tuple(found)
        else:
            self._at.pop(place, None)
        for finding in found:
            self._before.setdefault(finding.key, None)
            self._all[finding.key] = finding


def _measured_anew(before: NavGraph, after: NavGraph) -> set[str]:
    """Return the viewpoints from which evidence was measured that was added, removed or changed."""
    if before.evidence is after.evidence:
        return set()
    touched = elements_touched_between(before, after)
    keys = {*before.evidence, *after.evidence} if touched is None else touched.evidence
    found: set[str] = set()
    for key in keys:
        old, new = before.evidence.get(key), after.evidence.get(key)
        if old is not new:
            found.update(e.viewpoint for e in (old, new) if e is not None)
    return found


def _pair(a: str, b: str) -> tuple[str, str, str]:
    return ("pair", a, b) if a < b else ("pair", b, a)


def about_detour(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    """Return the finding that the graph has only a long path between two near viewpoints. Returns none if the map, the
    lists of a file, or the evidence show an obstacle between them."""
    if not _may_join(graph, key, context.limits) or key[1] in ids_within(graph, key[0], context.limits.detour):
        return []
    return _detour_findings(graph, key, context)


def influence_radius(limits: Limits) -> float:
    """Return the radius in meters around the ends of changed edges within which detour findings can change. Each
    changed path is at most `detour` long, so one of its halves is within half of that."""
    return max(limits.neighbors, limits.detour / 2)


def ids_within(graph: NavGraph, start: str, limit: float) -> set[str]:
    """Return the ids of the included viewpoints that a path of at most `limit` meters leads to (Dijkstra)."""
    done: set[str] = set()
    front = [(0.0, start)]
    while front:
        far, id = heapq.heappop(front)
        if id in done:
            continue
        done.add(id)
        here = graph.viewpoints[id].position
        for other in graph.neighbors(id):
            viewpoint = graph.viewpoints[other]
            if other not in done and viewpoint.included:
                along = far + math.dist(here, viewpoint.position)
                if along <= limit:
                    heapq.heappush(front, (along, other))
    return done


class DetourFindings:
    """The detour findings of a graph, updated after each edit."""

    def __init__(self) -> None:
        self._found: dict[str, set[str]] = {}  # viewpoint -> viewpoints that it has a finding with
        self._kept: dict[EdgeKey, tuple[tuple[object, ...], list[Finding]]] = {}  # inputs -> findings

    def update(
        self, graph: NavGraph, near: Mapping[str, Sequence[str]], context: Context
    ) -> dict[EdgeKey, list[Finding]]:
        """Return the findings about each viewpoint and the viewpoints `near` it. Pairs whose finding is resolved have
        an empty list."""
        found: dict[EdgeKey, list[Finding]] = {}
        ways: dict[str, set[str]] = {}
        for id, others in near.items():
            joined, now = graph.neighbors(id), set()
            for other in others:
                if other in joined:
                    continue
                key = (id, other) if id < other else (other, id)
                if key not in found and _may_join(graph, key, context.limits):
                    if key[0] not in ways:
                        ways[key[0]] = ids_within(graph, key[0], context.limits.detour)
                    far = key[1] not in ways[key[0]]
                    found[key] = self._findings_of_pair(graph, key, context) if far else []
                if found.get(key):
                    now.add(other)
            for other in self._found.get(id, set()) - now:
                found[(id, other) if id < other else (other, id)] = []
                self._found[other].discard(id)
            for other in now:
                self._found.setdefault(other, set()).add(id)
            self._found[id] = now
        return found

    def _findings_of_pair(self, graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
        seen: tuple[object, ...] = (graph.viewpoints[key[0]], graph.viewpoints[key[1]])
        if context.closed is not None:
            seen += tuple(graph.evidence[k] for id in key for k in graph.evidence_of.get(id, ()))
        known = self._kept.get(key)
        if known is None or len(known[0]) != len(seen) or any(map(is_not, known[0], seen)):
            known = self._kept[key] = (seen, _detour_findings(graph, key, context))
        return known[1]


def _may_join(graph: NavGraph, key: EdgeKey, limits: Limits) -> bool:
    """Whether two viewpoints without an edge could have a short and level one."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    if key in graph.edges or not limits.near <= math.dist(a.position, b.position) < limits.neighbors:
        return False
    rise = abs(a.position[2] - a.height - b.position[2] + b.height)
    run = math.hypot(a.position[0] - b.position[0], a.position[1] - b.position[1])
    return rise <= _LEVEL and math.degrees(math.atan2(rise, run)) <= limits.steep


def _detour_findings(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    if context.crosses_obstacle(a.position, b.position) or (context.closed is not None and context.closed(graph, key)):
        return []
    if context.visible is not None and not context.visible(np.array([a.position]), np.array([b.position]))[0]:
        return []
    apart, limit = math.dist(a.position, b.position), context.limits.detour
    names = f"Viewpoints {graph.short(a.id)} and {graph.short(b.id)}"
    message = f"{names} are {apart:.1f} m apart, but more than {limit:g} m along the graph."
    fixes = (Fix("Join them", "add_edges", {"pairs": [list(key)]}),)
    return [Finding("detour", "notice", message, key, fixes=fixes)]
