"""The reasons, in words, against the corridors they were made from."""

from __future__ import annotations

import math
from dataclasses import replace

import demo_room
import numpy as np
import pytest

from app.state.evidence_words import clear_metres, compass, findings, sentence

GRAPH = demo_room.graph(demo_room.submaps(demo_room.capture()))
SOME = next(iter(GRAPH.evidence.values()))


@pytest.mark.parametrize(
    ("degrees", "name"),
    [(0, "north"), (90, "east"), (180, "south"), (265, "west"), (-45, "north-west"), (23, "north-east")],
)
def test_headings_have_compass_names(degrees: float, name: str) -> None:
    assert compass(math.radians(degrees)) == name


def test_the_clear_way_ends_at_the_first_blocked_row() -> None:
    alpha = np.zeros((10, 5), np.uint8)
    alpha[6, 2] = 255
    evidence = replace(SOME, alpha=alpha, near=0.2, depth=0.23, length=2.5)
    assert clear_metres(evidence) == pytest.approx(0.2 + 6 * 0.23)
    assert "something stands at 1.6 m" in sentence(replace(evidence, decision="alpha"))


def test_a_clear_corridor_is_clear_over_its_length() -> None:
    assert clear_metres(replace(SOME, alpha=np.zeros((10, 5), np.uint8), length=2.5)) == 2.5


@pytest.mark.parametrize("decision", ["open", "alpha", "normal", "unknown", "distance", "limit", "merge", "", "other"])
def test_every_decision_has_words(decision: str) -> None:
    assert len(sentence(replace(SOME, decision=decision))) > 4


def test_a_viewpoint_has_its_eight_directions_clockwise_and_its_merges_last() -> None:
    id = next(iter(GRAPH.viewpoints))
    other = list(GRAPH.viewpoints)[1]
    merge = replace(GRAPH.evidence[(id, 0)], direction=8, joins=other, decision="open", heading=0.1)
    graph = replace(GRAPH, evidence={**GRAPH.evidence, (id, 8): merge})
    found = findings(graph, id)
    assert len(found) == 9 and not found[-1].lattice
    headings = [f.heading for f in found[:8]]
    assert headings == sorted(headings)
    assert other[:6] in found[-1].words


def test_an_edge_that_a_person_removed_is_said_to_be_removed() -> None:
    id, other = list(GRAPH.viewpoints)[:2]
    merge = replace(GRAPH.evidence[(id, 0)], direction=8, joins=other, decision="open")
    graph = replace(GRAPH, evidence={(id, 8): merge}, edges={})
    assert "removed" in findings(graph, id)[0].words
