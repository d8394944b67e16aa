"""Deciding a graph again from its evidence: as the builder decided, in arrays, and fast enough for a slider."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import can_stand, decide
from nvsim.mapping.evidence.evidence_stack import decision_names
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.occupancy.types import OCCUPIED

SMALL = MappingConfig(view_size=96)


@cache
def built(config: MappingConfig = SMALL) -> tuple[NavGraph, np.ndarray]:
    occupancy = fill(fill(room(9, 8), 3, 2.5, 4.2, 4.5, OCCUPIED), 6.5, 0, 6.6, 4.6, OCCUPIED)
    xy = np.array([(1.5, 1.5), (3, 1.5), (5, 1.5), (5, 3), (5, 5), (5, 6), (3.5, 6), (2, 6)])
    walk = np.column_stack([xy, np.full(len(xy), 1.2)])
    world = Columns(occupancy, noise=0.12)
    return build_map(world, walk, flat_floor, world.support, config, scan="test").graph, walk


configs = st.builds(
    MappingConfig,
    rule=st.sampled_from(["mean", "worst"]),
    tau_alpha=st.floats(0, 1),
    tau_normal=st.floats(0, 1),
    row_alpha=st.floats(0, 1),
    cell_alpha=st.floats(0, 1),
    row_normal=st.floats(0, 1),
    support=st.floats(0, 1),
    both_ways=st.booleans(),
    robot_radius=st.floats(0, 0.4),
    margin=st.just(0.05),
)


@settings(max_examples=60, deadline=None)
@given(configs)
def test_every_corridor_is_decided_as_one_by_one(config: MappingConfig) -> None:
    graph, walk = built()
    found = Rethresholder(graph, walk).decide(config)
    evidence = list(graph.evidence.values())
    assert [decision_names()[c] for c in found.codes] == [decide(e, config) for e in evidence]
    stands = Rethresholder(graph)._stack.can_stand(config)
    for id, stand in zip(graph.viewpoints, stands, strict=True):
        around = [e for e in evidence if e.viewpoint == id and e.direction < 8]
        assert stand == can_stand(around, config)


@pytest.mark.parametrize("config", [SMALL, replace(MappingConfig.paper(), view_size=96)], ids=["nvsim", "paper"])
def test_the_thresholds_it_was_built_with_change_nothing(config: MappingConfig) -> None:
    graph, walk = built(config)
    redecider = Rethresholder(graph, walk)
    found = redecider.decide(config)
    assert not found and found.isolated_viewpoints == found.kept_by_user == found.new_steps == 0
    after = redecider.apply(found)
    assert after.edges == graph.edges and all(after.evidence[k] is e for k, e in graph.evidence.items())


def test_stricter_thresholds_take_away_exactly_the_edges_whose_corridors_fail() -> None:
    graph, walk = built()
    strict = replace(SMALL, row_alpha=0.12, robot_radius=0.35)
    redecider = Rethresholder(graph, walk)
    found = redecider.decide(strict)
    gone = {edge(redecider.ids[a], redecider.ids[b]).key for a, b in found.lost_edges}
    expected = set()
    for a, b in graph.edges:
        ways = [
            e
            for e in graph.evidence.values()
            for x, y in ((a, b), (b, a))
            if e.viewpoint == x and np.hypot(*np.subtract(e.target, graph.viewpoints[y].position[:2])) < 0.01
        ]
        stand = all(can_stand([e for (v, k), e in graph.evidence.items() if v == x and k < 8], strict) for x in (a, b))
        if not stand or any(decide(e, strict) != "open" for e in ways):
            expected.add((a, b))
    assert gone == expected and 0 < len(gone) < len(graph.edges) and not len(found.new_edges)
    # ... and come back when the limits do, with the words they had.
    after = redecider.apply(found)
    assert set(after.edges) == set(graph.edges) - gone
    back = Rethresholder(after, walk)
    again = back.apply(back.decide(SMALL))
    assert dict(again.edges) == dict(graph.edges)
    assert [e.decision for e in again.evidence.values()] == [e.decision for e in graph.evidence.values()]


def test_what_a_person_made_stays_and_what_a_person_removed_does_not_return() -> None:
    graph, walk = built()
    removed = next(iter(graph.edges))
    edges = {key: e for key, e in graph.edges.items() if key != removed}
    mine = next(iter(edges))
    edges[mine] = edge(*mine, "person")
    edited = replace(graph, edges=edges)
    assert not Rethresholder(edited, walk).decide(SMALL)
    closed = Rethresholder(edited, walk).decide(replace(SMALL, tau_alpha=0.0))
    assert closed.kept_by_user == 1 and len(closed.lost_edges) == len(edges) - 1
    loose = Rethresholder(edited, walk).decide(replace(SMALL, row_alpha=1.0, cell_alpha=1.0))
    ids = tuple(edited.viewpoints)
    assert removed not in {edge(ids[a], ids[b]).key for a, b in loose.new_edges}


def test_looser_thresholds_say_how_much_new_ground_they_open() -> None:
    graph, walk = built()
    loose = Rethresholder(graph, walk).decide(
        replace(SMALL, row_alpha=1.01, cell_alpha=1.01, tau_alpha=1.01, support=0.0)
    )
    assert loose.new_steps > 0 and not len(loose.lost_edges)


def test_a_viewpoint_far_from_the_walk_loses_its_edges() -> None:
    graph, walk = built()
    near = Rethresholder(graph, walk).decide(replace(SMALL, max_distance=0.3))
    assert len(near.lost_edges) > 0 and near.isolated_viewpoints > 0
    assert not Rethresholder(graph).decide(replace(SMALL, max_distance=0.3))  # nobody knows the walk


def test_a_graph_without_evidence_has_nothing_to_decide() -> None:
    graph = NavGraph(
        "x", {"a": Viewpoint("a", (0, 0, 1)), "b": Viewpoint("b", (1, 0, 1))}, {("a", "b"): edge("a", "b")}
    )
    assert not Rethresholder(graph).decide(SMALL) and not Rethresholder(NavGraph("x")).decide(SMALL)
