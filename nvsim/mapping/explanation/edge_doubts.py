"""Why the stored evidence contradicts an edge, for the findings of a graph."""

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
