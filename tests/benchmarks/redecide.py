"""Measure the response time of a threshold slider for graphs of 1,000 and of 10,000 viewpoints.

python -m tests.benchmarks.redecide
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor, headings
from nvsim.mapping.evidence.rethreshold import Rethresholder
from tests.benchmarks.harness import report, timed, times


def field(side: int) -> NavGraph:
    """A square of side x side viewpoints at the spacing of steps. Each viewpoint has evidence of eight steps and of up
    to six corridors to other viewpoints. Some of them are blocked."""
    config, rng = MappingConfig(), np.random.default_rng(0)
    ahead = headings(config)
    axes = [config.tau_dist * np.array([np.sin(h), np.cos(h)]) for h in ahead[:3:2]]
    ids = {(i, j): f"{i:04d}{j:04d}" for i in range(side) for j in range(side)}
    at = {key: key[0] * axes[0] + key[1] * axes[1] for key in ids}
    viewpoints = {ids[k]: Viewpoint(ids[k], (*map(float, at[k]), 1.5)) for k in ids}
    evidence: dict[tuple[str, int], Evidence] = {}
    edges = {}

    def measured(key: tuple[int, int], k: int, target: tuple[float, float], joins: str) -> None:
        corridor = Corridor(viewpoints[ids[key]].position[:2], target)
        alpha = np.clip(rng.normal(12, 9, (corridor.rows, CELLS)), 0, 255).astype(np.uint8)
        if rng.random() < 0.3:
            alpha[rng.integers(corridor.rows) :] = 240
        up, known = np.full_like(alpha, 245), np.ones(alpha.shape, bool)
        word = "alpha" if alpha.max() > 127 else "open"
        evidence[ids[key], k] = Evidence(
            ids[key], k, corridor.heading, corridor.length, alpha, up, known, NEAR, DEPTH, WIDTH, 0, target, joins, word
        )

    for key in ids:
        for k in range(8):
            x, y = at[key] + config.tau_dist * np.array([np.sin(ahead[k]), np.cos(ahead[k])])
            measured(key, k, (float(x), float(y)), "")
        for n, (di, dj) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1), (2, 1), (1, 2))):
            other = ids.get((key[0] + di, key[1] + dj))
            if other is not None:
                x, y, _ = viewpoints[other].position
                measured(key, 8 + n, (x, y), other)
                edges[edge(ids[key], other).key] = edge(ids[key], other, "merge")
    return NavGraph("field", viewpoints, edges, evidence)


def step_times(work: Callable[[int], object], count: int = 15) -> dict[str, float]:
    """Milliseconds: the first call, and the median and maximum of the others."""
    taken = times(work, count)
    names = {"first_ms": taken[0], "median_ms": statistics.median(taken[1:]), "max_ms": max(taken[1:])}
    return {name: round(value, 2) for name, value in names.items()}


def measured_on(side: int) -> dict[str, object]:
    """The figures of one graph."""
    config, graph = MappingConfig(), field(side)
    places = np.array([v.position for v in graph.viewpoints.values()][::3])
    redecider, prepared = timed(lambda: Rethresholder(graph, places))
    strict = redecider.decide(replace(config, robot_radius=0.4))
    return {
        "viewpoints": len(graph.viewpoints),
        "edges": len(graph.edges),
        "evidence": len(graph.evidence),
        "prepare_s": round(prepared, 3),
        "limit": step_times(lambda i: redecider.decide(replace(config, row_alpha=0.1 + 0.01 * i))),
        "robot": step_times(lambda i: redecider.decide(replace(config, robot_radius=0.15 + 0.01 * i))),
        "apply": step_times(lambda i: redecider.apply(strict), 4),
    }


def main() -> None:
    for side in (32, 100):
        report(measured_on(side), as_json=True)


if __name__ == "__main__":
    main()
