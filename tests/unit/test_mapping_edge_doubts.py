"""Texts for the stored evidence against an edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nvsim.graph import edits
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.explain import closed_edge_reason


def evidence(alpha: float, up: float = 1.0, support: bool = True, joins: str = "b") -> Evidence:
    shape = (29, 18)
    cells = [np.full(shape, round(255 * value), np.uint8) for value in (alpha, up)]
    cells = [np.full(shape, round(255 * value), np.uint8) for value in (alpha, up)]
    return Evidence(
        "a", 2, np.pi / 2, 2.5, *cells, np.full(shape, support),
        near=0.0, depth=0.1, width=0.6, submap=0, target=(2.5, 0.0), joins=joins,
    )  # fmt: skip


def graph_with(found: Evidence) -> NavGraph:
    viewpoints = {id: Viewpoint(id, (x, 0.0, 1.5)) for id, x in (("a", 0.0), ("b", 2.5))}
    return NavGraph("scan", viewpoints, {("a", "b"): edge("a", "b")}, {found.key: found})


@pytest.mark.parametrize("joins", ["b", ""])
@pytest.mark.parametrize(
    ("found", "words"),
    [
        (evidence(0.0), ""),
        (evidence(1.0), "an obstacle is"),
        (evidence(0.0, up=0.0), "does not face up"),
        (evidence(0.0, support=False), "no image and no LiDAR scan"),
    ],
)
def test_the_first_criterion_that_fails_is_the_reason(found: Evidence, words: str, joins: str) -> None:
    why = closed_edge_reason(MappingConfig())(graph_with(replace(found, joins=joins)), ("a", "b"))
    assert words in why and bool(words) == bool(why)


def test_evidence_from_before_a_move_says_nothing() -> None:
    graph = edits.move_viewpoint(graph_with(evidence(1.0)), "b", (2.4, 0.3, 1.5))
    assert closed_edge_reason(MappingConfig())(graph, ("a", "b")) == ""
