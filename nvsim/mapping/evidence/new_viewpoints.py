"""Measure evidence for viewpoints that a user added or moved, as the map builder would have done."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from nvsim.errors import InputError
from nvsim.events import Listener, Progress, ignore_event
from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, HeightAt, Lattice, SupportAt
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.evidence.measuring import Measurements
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.mapping.views.view_sources import ViewSource

STAGE = "evidence"
_DETOUR = 1.5  # ratio to the straight distance
_MOST = 12  # maximum corridors to viewpoints nearby, the nearest first, in addition to those it is joined to


@dataclass(frozen=True, eq=False)
class NewViewpointEvidence:
    """The evidence of new viewpoints.

    evidence  of every requested viewpoint, and of the corridors from others to them
    submaps   id -> the submap that renders it
    proposed  pairs a < b with a free corridor but without an edge, and without a short detour over a third viewpoint
    doubted   pairs a < b with an edge although the corridor between them is not free
    photographed  id -> photographed share of the viewpoint, None if it was not measured
    """

    evidence: tuple[Evidence, ...]
    submaps: dict[str, int]
    proposed: tuple[tuple[str, str], ...]
    doubted: tuple[tuple[str, str], ...]
    photographed: Mapping[str, float | None] = field(default_factory=dict)


def measure_new_viewpoints(
    graph: NavGraph,
    ids: Iterable[str],
    source: ViewSource,
    floor_at: HeightAt,
    support: SupportAt,
    config: MappingConfig,
    *,
    traversed: TraversedFloor | None = None,
    listen: Listener = ignore_event,
) -> NewViewpointEvidence:
    """Render the eight directions of each viewpoint, and measure the corridors to and from the viewpoints around it.
    `traversed` is as in `Measurements`.

    Raises InputError if a viewpoint is not in `graph`.
    """
    wanted = list(dict.fromkeys(ids))
    for id in wanted:
        if id not in graph.viewpoints:
            raise InputError(f"The graph has no viewpoint {id}; check the id.")
    lattice = Lattice(config)
    measurements = Measurements(source, floor_at, support, config, lattice, traversed=traversed)
    found: dict[str, list[Evidence]] = {}
    submaps: dict[str, int] = {}
    decisions: dict[tuple[str, str], list[str]] = {}
    for done, id in enumerate(wanted):
        listen(Progress(STAGE, done, len(wanted), f"viewpoint {done + 1} of {len(wanted)}"))
        viewpoint = graph.viewpoints[id]
        lattice.begin(id, viewpoint.position[:2])
        around = _neighbors_to_measure(graph, id, config)
        steps = measurements.around(viewpoint, [graph.viewpoints[other] for other in around])
        submaps[id] = steps[0].submap
        found.setdefault(id, []).extend(replace(e, decision=decide(e, config)) for e in steps)
        for other in around:
            key = (min(id, other), max(id, other))
            if key in decisions:
                continue
            ways = [(id, other), (other, id)] if config.both_ways else [(id, other)]
            for a, b in ways:
                evidence = measurements.corridor_evidence(graph.viewpoints[a], graph.viewpoints[b])
                evidence = replace(evidence, decision=decide(evidence, config))
                decisions.setdefault(key, []).append(evidence.decision)
                found.setdefault(a, []).append(evidence)
    listen(Progress(STAGE, len(wanted), len(wanted), ""))
    opened = {key for key, words in decisions.items() if all(word == OPEN for word in words)}
    return NewViewpointEvidence(
        tuple(e for id, several in found.items() for e in _number_directions(graph, id, several, id in submaps)),
        submaps,
        tuple(sorted(key for key in opened if key not in graph.edges and not _has_short_detour(graph, *key))),
        tuple(sorted(key for key in decisions if key in graph.edges and key not in opened)),
    )


def with_new_viewpoints(graph: NavGraph, measured: NewViewpointEvidence) -> NavGraph:
    """Return the graph with the new evidence, which replaces the stored evidence of these corridors."""
    again = {id for id, viewpoint in measured.submaps.items() if id in graph.viewpoints}
    corridors = {(e.viewpoint, e.joins) for e in measured.evidence if e.joins}
    evidence = {
        key: e
        for key, e in graph.evidence.items()
        if e.viewpoint not in again and (e.viewpoint, e.joins) not in corridors
    }
    for e in measured.evidence:
        if e.viewpoint in graph.viewpoints and (not e.joins or e.joins in graph.viewpoints):
            evidence[e.key] = e
    viewpoints = {
        id: replace(v, submap=measured.submaps[id], photographed=measured.photographed.get(id)) if id in again else v
        for id, v in graph.viewpoints.items()
    }
    return replace(graph, viewpoints=viewpoints, evidence=evidence)


def _neighbors_to_measure(graph: NavGraph, id: str, config: MappingConfig) -> list[str]:
    """Return the viewpoints that it is joined to, and the nearest others within reach of a step."""
    here = graph.viewpoints[id]
    names = [other for other, v in graph.viewpoints.items() if other != id and v.included]
    places = np.array([graph.viewpoints[other].position for other in names]).reshape(-1, 3)
    distance = np.linalg.norm(places - here.position, axis=1)
    level = np.abs(places[:, 2] - here.position[2]) < 0.5 * config.tau_dist
    reach = config.tau_dist + config.merge_radius
    near = [names[i] for i in np.argsort(distance, kind="stable") if distance[i] <= reach and level[i]][:_MOST]
    joined = [other for other in graph.neighbors(id) if math.dist(graph.viewpoints[other].position, here.position) > 0]
    return list(dict.fromkeys([*joined, *near]))


def _has_short_detour(graph: NavGraph, a: str, b: str) -> bool:
    """Whether a third viewpoint joins the two with a short detour."""
    places = graph.viewpoints
    direct = math.dist(places[a].position, places[b].position)
    between = set(graph.neighbors(a)) & set(graph.neighbors(b))
    return any(
        math.dist(places[a].position, places[c].position) + math.dist(places[c].position, places[b].position)
        < _DETOUR * direct
        for c in between
    )


def _number_directions(graph: NavGraph, id: str, several: list[Evidence], whole: bool) -> list[Evidence]:
    """Give corridors to viewpoints a direction from 8 on: the stored one, or a free one."""
    known = {e.joins: e.direction for (v, _), e in graph.evidence.items() if v == id and e.joins and not whole}
    free = max([DIRECTIONS - 1, *known.values()]) + 1
    result = []
    for e in several:
        if e.joins:
            direction = known.get(e.joins, free)
            free += direction == free
            e = replace(e, direction=direction)
        result.append(e)
    return result
