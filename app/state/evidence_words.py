"""Why a direction is open or not, said in words from the stored evidence. Knows no Qt."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nvsim.graph.types import Evidence, NavGraph, edge

_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


@dataclass(frozen=True)
class Finding:
    """heading radians; direction in words; open whether an edge came of it; reach 0 to 1 how far the way is clear;
    lattice False for the corridor to an existing viewpoint; one sentence."""

    heading: float
    direction: str
    open: bool
    reach: float
    lattice: bool
    words: str


def compass(heading: float) -> str:
    """The nearest of eight points; 0 is north (+y), clockwise."""
    return _POINTS[round(heading / (math.pi / 4)) % 8]


def clear_metres(evidence: Evidence, limit: float = 0.95) -> float:
    """How far ahead the corridor is free of cells whose alpha exceeds `limit`, metres, at most its length."""
    blocked = np.flatnonzero((evidence.alpha > limit * 255).any(axis=1))
    if len(blocked) == 0:
        return evidence.length
    return min(evidence.length, evidence.near + float(blocked[0]) * evidence.depth)


def sentence(evidence: Evidence) -> str:
    """What was measured and what followed from it."""
    mean = float(evidence.alpha.mean()) / 255 if evidence.alpha.size else 0.0
    worst = float(evidence.alpha.mean(axis=1).max()) / 255 if evidence.alpha.size else 0.0
    share = float(evidence.support.mean()) if evidence.support.size else 0.0
    decision = evidence.decision
    if decision == "open":
        goal = f" to viewpoint {evidence.joins[:6]}" if evidence.joins else ""
        return f"open{goal}: {evidence.length:.2f} m, mean alpha {mean:.2f}"
    if decision == "alpha":
        return f"something stands at {clear_metres(evidence):.1f} m: mean alpha {mean:.2f}, worst row {worst:.2f}"
    if decision == "normal":
        up = float(evidence.up.mean()) / 255 if evidence.up.size else 0.0
        return f"what lies there does not face up: mean upward normal {up:.2f}"
    if decision == "unknown":
        return f"nobody saw the floor there: {100 * share:.0f} % of the corridor is supported"
    if decision == "distance":
        return "too far from the trajectory"
    if decision == "limit":
        return "the search had reached its limit of viewpoints"
    if decision == "return":
        return "the way there is free, the way back is not"
    if decision == "merge":
        return f"the way to the viewpoint {evidence.joins[:6] or 'nearby'} is not clear"
    return decision or "not decided"


def findings(graph: NavGraph, viewpoint: str) -> list[Finding]:
    """One for each piece of evidence of `viewpoint`, clockwise from north, lattice directions before merges."""
    result = []
    for (id, direction), evidence in graph.evidence.items():
        if id != viewpoint:
            continue
        is_open = evidence.decision == "open"
        reach = 1.0 if is_open else max(0.12, min(1.0, clear_metres(evidence) / max(evidence.length, 1e-6)))
        words = sentence(evidence)
        if is_open and evidence.joins and edge(viewpoint, evidence.joins).key not in graph.edges:
            words += " (the edge was removed later)"
        heading = evidence.heading % (2 * math.pi)
        result.append(Finding(heading, compass(heading), is_open, reach, direction < 8, words))
    return sorted(result, key=lambda f: (not f.lattice, f.heading))
