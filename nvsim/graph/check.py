"""What an agent or a person would trip over in a graph."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nvsim.graph.components import components
from nvsim.graph.types import NavGraph, Viewpoint


@dataclass(frozen=True)
class Finding:
    """kind       "isolated", "island", "duplicate", "long" or "short"
    severity   "error" where agents fail, else "warning"
    message    one sentence
    viewpoints the ids concerned
    """

    kind: str
    severity: str
    message: str
    viewpoints: tuple[str, ...]


def check_graph(
    graph: NavGraph, too_near: float = 0.25, too_long: float = 5.0, too_short: float = 0.25
) -> list[Finding]:
    """Findings about included viewpoints and edges between them; distances in metres."""
    included = [v for v in graph.viewpoints.values() if v.included]
    joined = {id for key in graph.edges if all(graph.viewpoints[k].included for k in key) for id in key}
    findings = [
        Finding("isolated", "error", f"Viewpoint {v.id} has no edge: agents do not find it in the graph.", (v.id,))
        for v in included
        if v.id not in joined
    ]
    for group in components(graph)[1:]:
        if len(group) > 1:
            text = f"{len(group)} viewpoints around {group[0]} cannot be reached from the others."
            findings.append(Finding("island", "warning", text, tuple(group)))
    for a, b in _near_pairs(included, too_near):
        text = f"Viewpoints {a.id} and {b.id} are {_distance(a, b):.2f} m apart: they are nearly the same place."
        findings.append(Finding("duplicate", "warning", text, (a.id, b.id)))
    for x, y in graph.edges:
        a, b = graph.viewpoints[x], graph.viewpoints[y]
        length = _distance(a, b)
        if length > too_long:
            findings.append(Finding("long", "warning", f"The edge from {x} to {y} is {length:.1f} m long.", (x, y)))
        elif length < too_short:
            findings.append(Finding("short", "warning", f"The edge from {x} to {y} is {length:.2f} m long.", (x, y)))
    return findings


def _distance(a: Viewpoint, b: Viewpoint) -> float:
    return math.dist(a.position, b.position)


def _near_pairs(viewpoints: list[Viewpoint], reach: float) -> list[tuple[Viewpoint, Viewpoint]]:
    """Pairs nearer than `reach`, by buckets of that size."""
    buckets: dict[tuple[int, int, int], list[Viewpoint]] = {}
    pairs = []
    for v in viewpoints:
        x, y, z = (math.floor(value / reach) for value in v.position)
        for i in (x - 1, x, x + 1):
            for j in (y - 1, y, y + 1):
                for k in (z - 1, z, z + 1):
                    pairs += [(u, v) for u in buckets.get((i, j, k), ()) if _distance(u, v) < reach]
        buckets.setdefault((x, y, z), []).append(v)
    return pairs
