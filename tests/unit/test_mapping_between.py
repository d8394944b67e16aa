"""Why there is an edge between two viewpoints, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from columns import fill, room
from test_mapping_unmeasured import CONFIG, built, start_of, with_neighbor

from nvsim.graph import edits
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.explanation.path_explanation import explain_path
from nvsim.occupancy.types import OCCUPIED

POST = (3.55, 1.85, 3.85, 2.15)


def test_a_post_is_found_by_the_evidence_and_by_the_map_at_its_place() -> None:
    plan = fill(room(6, 4), *POST, OCCUPIED)
    graph = with_neighbor(built(plan), np.radians(90), 1.4)
    found = explain_path(graph, start_of(graph), "beside", CONFIG, plan)
    assert not found.joined and found.meters == pytest.approx(1.4) and found.rise == pytest.approx(0.0)
    assert found.blocked == pytest.approx(0.55, abs=0.06) and found.unknown == pytest.approx(0.3 / 1.4, abs=0.05)
    there, back = found.ways
    assert there.source and there.found.decision != OPEN and back.source == "", "nothing was measured from the new one"
    assert found.support_of_edge == -1
    assert found.sentence.startswith(f"There is no edge, because seen from {start_of(graph)} ")


def test_free_floor_speaks_for_an_edge_and_the_verdicts_are_those_of_the_builder() -> None:
    plan = room(6, 4)
    graph = with_neighbor(built(plan), 0.0, 1.2)
    id = start_of(graph)
    found = explain_path(graph, id, "beside", CONFIG, plan)
    assert found.blocked is None and found.unknown == 0.0 and found.support_of_edge == 1
    asked = {m.criterion.field for m in found.ways[0].found.measures if m.decides}
    assert {"tau_alpha", "tau_normal", "support"} <= asked and all(m.passes for m in found.ways[0].found.measures)
    joined = explain_path(edits.add_edge(graph, id, "beside"), id, "beside", CONFIG, plan)
    assert joined.joined and joined.sentence.startswith("There is an edge, and ")
    open_one = next(e for e in graph.evidence.values() if e.viewpoint == id and decide(e, CONFIG) == OPEN)
    spared = replace(graph, evidence={open_one.key: replace(open_one, decision="spare", joins="beside")})
    told = explain_path(spared, id, "beside", CONFIG)
    assert told.sentence == "There is no edge, because the path is free, but another path is hardly longer."


def test_without_evidence_the_map_speaks_and_without_that_nothing_does() -> None:
    plan = room(6, 4)
    graph = replace(with_neighbor(built(plan), 0.0, 1.2), evidence={})
    id = start_of(graph)
    assert explain_path(graph, id, "beside", CONFIG, plan).support_of_edge == 1
    assert explain_path(graph, id, "beside", CONFIG, fill(plan, 2.5, 2.4, 3.5, 2.6, OCCUPIED)).support_of_edge == -1
    nothing = explain_path(graph, id, "beside", CONFIG)
    assert nothing.support_of_edge == 0 and nothing.sentence == (
        "There is no edge, and nothing was measured along the 1.20 m between them."
    )
