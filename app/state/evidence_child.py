"""Measures added or moved viewpoints in a side process while the user continues to edit. Does not use Qt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.processes.child import Program
from app.processes.serving import Requests
from nvsim.graph.types import NavGraph
from nvsim.mapping.evidence.new_viewpoints import NewViewpointEvidence

AROUND = 8.0  # meters; viewpoints farther from the measured ones do not affect the result


@dataclass(frozen=True, eq=False)
class EvidenceTask:
    """Measures the viewpoints `ids` of `graph`, a part of the project's graph."""

    project: Path
    graph: NavGraph
    ids: tuple[str, ...]

    def __reduce__(self) -> tuple[object, ...]:
        """Encodes the graph, because its read-only mappings cannot be pickled."""
        from nvsim.graph.store import encode_graph

        return _decoded, (self.project, encode_graph(self.graph), self.ids)


@dataclass(frozen=True, eq=False)
class Measured:
    """The evidence, and the measured positions by viewpoint id."""

    found: NewViewpointEvidence
    positions: dict[str, tuple[float, float, float]]


def _decoded(project: Path, graph: bytes, ids: tuple[str, ...]) -> EvidenceTask:
    from nvsim.graph.store import decode_graph

    return EvidenceTask(project, decode_graph(graph), ids)


def evidence_task(project: Path, graph: NavGraph, ids: Sequence[str]) -> EvidenceTask:
    """The task to measure the viewpoints `ids` of `graph`."""
    return EvidenceTask(project, _part(graph, tuple(ids)), tuple(ids))


def _measure(requests: Requests, task: EvidenceTask) -> Measured:
    from nvsim.cli.arguments import memory_budget
    from nvsim.mapping.config import MappingConfig
    from nvsim.project.project import Project
    from nvsim.project.stages.measured import measure

    with Project.open(task.project) as project:
        found = measure(project, task.graph, task.ids, MappingConfig(), lambda event: None, memory_budget(None))
    return Measured(found, {id: task.graph.viewpoints[id].position for id in task.ids})


def _part(graph: NavGraph, ids: tuple[str, ...]) -> NavGraph:
    """The part of the graph that affects the measurement: near viewpoints with their edges and corridors."""
    centres = [graph.viewpoints[id].position for id in ids]
    near = {
        id: v for id, v in graph.viewpoints.items() if any(math.dist(v.position, centre) < AROUND for centre in centres)
    }
    for id in ids:
        near |= {other: graph.viewpoints[other] for other in graph.neighbours(id)}
    return NavGraph(
        graph.scan,
        near,
        {key: e for key, e in graph.edges.items() if key[0] in near and key[1] in near},
        {key: e for key, e in graph.evidence.items() if e.joins and e.viewpoint in near and e.joins in near},
    )


EVIDENCE = Program(_measure, "evidence", "The viewpoints cannot be measured")
"""EvidenceTask -> Measured"""
