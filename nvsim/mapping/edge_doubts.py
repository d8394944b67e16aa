"""Why the stored evidence speaks against an edge: what a graph's findings ask of the map builder."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import EdgeKey, Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS, DISPUTED, OPEN, decide, lacking
from nvsim.mapping.explain import explain
from nvsim.mapping.graph_builder import SAME


def against(config: MappingConfig) -> Callable[[NavGraph, EdgeKey], str]:
    """(graph, edge) -> words, "" where the evidence in both directions is open or there is none. Stale evidence, from
    before one of the ends was moved, says nothing, and neither does what lacks a criterion's measurement."""

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
    """(graph, edge) -> how far the evidence along it, both ways and of all models asked, stays from the thresholds that
    decide, at the least; negative where one fails, NaN where nothing was measured or all is stale."""

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
