"""Why the stored evidence contradicts an edge, for the findings of a graph. For an edge that was not measured, the
corridors that were measured from its ends often cover most of the floor between them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import EdgeKey, Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DEPTH, NEAR, WIDTH, Corridor
from nvsim.mapping.criteria import CRITERIA, DECISIONS, DISPUTED, FULL, OPEN, decide, lacking
from nvsim.mapping.explanation.explain import explain
from nvsim.mapping.search.graph_builder import SAME

_FREE = {c.plane: 0 if c.below else FULL[c.plane] for c in CRITERIA}  # values of free floor in each plane
_BESIDE = math.radians(60.0)  # maximum angle of two headings; other corridors share only the floor under the camera


def closed(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], bool]:
    """Return (graph, pair of viewpoints) -> whether the path between the two is closed under `config`.

    Measured evidence along the path decides, or the detour of the trajectory. Without it, the cells of other corridors
    from either end decide, and floor that none of them covers counts as free. Returns False if nothing is known. Stale
    evidence is ignored.
    """

    def is_closed(graph: NavGraph, key: EdgeKey) -> bool:
        laid = (laid_over(graph, here, there) for here, there in (key, key[::-1]))
        along = evidence_along(graph, key)
        if any(e.decision == "around" for e in along):
            return True  # the reason is not in the planes of the evidence
        relevant = along or [found[0] for found in laid if found is not None]
        return any(decide(e, config) != OPEN for e in relevant if not lacking(e, config))

    return is_closed


def laid_over(graph: NavGraph, here: str, there: str) -> tuple[Evidence, float] | None:
    """Return the corridor from one viewpoint to the other, read from the corridors measured from the first, and the
    share of it that they cover, 0 to 1. Cells that none covers are free floor. Returns None if no corridor is near."""
    xy = np.array([graph.viewpoints[id].position[:2] for id in (here, there)])
    corridor = Corridor((float(xy[0, 0]), float(xy[0, 1])), (float(xy[1, 0]), float(xy[1, 1])))
    measured = [graph.evidence[k] for k in graph.evidence_of.get(here, ()) if k[0] == here]
    near = [e for e in measured if not e.stale and _turn(e.heading, corridor.heading) < _BESIDE]
    if not near:
        return None
    # The nearest heading comes last, so that its cells win: it sees them from the direction of the corridor.
    near.sort(key=lambda e: -_turn(e.heading, corridor.heading))
    cells = corridor.cells() - xy[0]
    planes: dict[str, Any] = {
        plane: np.full(cells.shape[:2], free, getattr(near[-1], plane).dtype)
        for plane, free in _FREE.items()
        if all(getattr(e, plane) is not None for e in near)
    }
    known = np.zeros(cells.shape[:2], bool)
    for e in near:
        forward = np.array([math.sin(e.heading), math.cos(e.heading)])
        row = np.floor((cells @ forward - e.near) / e.depth).astype(np.int64)
        across = cells @ np.array([forward[1], -forward[0]]) / e.width + 0.5
        column = np.floor(across * e.alpha.shape[1]).astype(np.int64)
        inside = (row >= 0) & (row < e.alpha.shape[0]) & (column >= 0) & (column < e.alpha.shape[1])
        known |= inside
        for plane, values in planes.items():
            values[inside] = getattr(e, plane)[row[inside], column[inside]]
    evidence = Evidence(
        here,
        near[-1].direction,
        corridor.heading,
        corridor.length,
        near=NEAR,
        depth=DEPTH,
        width=WIDTH,
        submap=near[-1].submap,
        target=corridor.target,
        joins=there,
        **planes,
    )
    return evidence, float(known.mean())


def _turn(a: float, b: float) -> float:
    """Radians between two headings."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


def against(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], str]:
    """Return (graph, edge) -> reason; "" if the evidence in both directions is open or missing. Evidence is ignored if
    it is stale because an end was moved, or if it lacks the data of a criterion."""

    def why(graph: NavGraph, key: EdgeKey) -> str:
        for here, there in (key, key[::-1]):
            for evidence in (graph.evidence[k] for k in graph.evidence_of.get(here, ())):
                if evidence.viewpoint != here or evidence.stale or not _leads_to(evidence, graph, there):
                    continue
                if lacking(evidence, config):
                    continue
                decision = decide(evidence, config)
                if decision == DISPUTED:
                    return f"seen from {graph.short(here)}, {DECISIONS[decision].clause} ({_sides(evidence, config)})"
                if decision != OPEN:
                    return f"seen from {graph.short(here)}, {DECISIONS[decision].clause}"
        return ""

    return why


def _sides(evidence: Evidence, config: MappingConfig) -> str:
    found = explain(evidence, config)
    clause = "" if found.failed is None else DECISIONS[found.failed.word].clause
    return f"{clause}: {found.disagreement}"


def margin(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], float]:
    """Return (graph, edge) -> smallest distance of the evidence to the thresholds that decide, over both directions and
    all models. Negative if a criterion fails, NaN if nothing was measured or all evidence is stale."""

    def least(graph: NavGraph, key: EdgeKey) -> float:
        found = [explain(e, config) for e in evidence_along(graph, key) if not lacking(e, config)]
        shown = [one for first in found for one in (first, first.other) if one is not None]
        return min((m.slack for one in shown for m in one.measures if m.decides), default=float("nan"))

    return least


def _leads_to(evidence: Evidence, graph: NavGraph, id: str) -> bool:
    if evidence.joins:
        return evidence.joins == id
    x, y = graph.viewpoints[id].position[:2]
    return bool(np.hypot(evidence.target[0] - x, evidence.target[1] - y) < SAME)
