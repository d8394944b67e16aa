"""Find near viewpoints with a long path between them in the graph. An agent one meter from its goal would then have to
take a long path."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from operator import is_not

import numpy as np

from nvsim.graph.findings.context import Context, Finding, Fix, Limits
from nvsim.graph.types import EdgeKey, NavGraph

_LEVEL = 0.5  # maximum height difference of two floors in meters; more indicates a railing, stairs or another storey


def about_detour(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    """Return the finding that the graph has only a long path between two near viewpoints. Returns none if the map, the
    lists of a file, or the evidence show an obstacle between them."""
    if not _may_join(graph, key, context.limits) or key[1] in ids_within(graph, key[0], context.limits.detour):
        return []
    return _found(graph, key, context)


def influence_radius(limits: Limits) -> float:
    """Return the radius in meters around the ends of changed edges within which detour findings can change. Each
    changed path is at most `detour` long, so one of its halves is within half of that."""
    return max(limits.neighbours, limits.detour / 2)


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
        for other in graph.neighbours(id):
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

    def look(
        self, graph: NavGraph, near: Mapping[str, Sequence[str]], context: Context
    ) -> dict[EdgeKey, list[Finding]]:
        """Return the findings about each viewpoint and the viewpoints `near` it. Pairs whose finding is resolved have
        an empty list."""
        found: dict[EdgeKey, list[Finding]] = {}
        ways: dict[str, set[str]] = {}
        for id, others in near.items():
            joined, now = graph.neighbours(id), set()
            for other in others:
                if other in joined:
                    continue
                key = (id, other) if id < other else (other, id)
                if key not in found and _may_join(graph, key, context.limits):
                    if key[0] not in ways:
                        ways[key[0]] = ids_within(graph, key[0], context.limits.detour)
                    far = key[1] not in ways[key[0]]
                    found[key] = self._about(graph, key, context) if far else []
                if found.get(key):
                    now.add(other)
            for other in self._found.get(id, set()) - now:
                found[(id, other) if id < other else (other, id)] = []
                self._found[other].discard(id)
            for other in now:
                self._found.setdefault(other, set()).add(id)
            self._found[id] = now
        return found

    def _about(self, graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
        seen: tuple[object, ...] = (graph.viewpoints[key[0]], graph.viewpoints[key[1]])
        if context.closed is not None:
            seen += tuple(graph.evidence[k] for id in key for k in graph.evidence_of.get(id, ()))
        known = self._kept.get(key)
        if known is None or len(known[0]) != len(seen) or any(map(is_not, known[0], seen)):
            known = self._kept[key] = (seen, _found(graph, key, context))
        return known[1]


def _may_join(graph: NavGraph, key: EdgeKey, limits: Limits) -> bool:
    """Whether two viewpoints without an edge could have a short and level one."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    if key in graph.edges or not limits.near <= math.dist(a.position, b.position) < limits.neighbours:
        return False
    rise = abs(a.position[2] - a.height - b.position[2] + b.height)
    run = math.hypot(a.position[0] - b.position[0], a.position[1] - b.position[1])
    return rise <= _LEVEL and math.degrees(math.atan2(rise, run)) <= limits.steep


def _found(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
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
