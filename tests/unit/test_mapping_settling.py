"""A settled graph in worlds of columns: near viewpoints are near in the graph, and nothing else got worse."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from nvsim.graph.paths import SAME_LENGTH
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.mapping.search.graph_builder import GraphBuilder
from nvsim.mapping.settling.draft_graph import NEAR, DraftGraph, remove_ties
from nvsim.occupancy.paths import segment_is_free
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

SMALL = MappingConfig(view_size=96)
LATTICES = replace(SMALL, settle=False, jitter=0.0)


def rooms() -> OccupancyMap:
    """Three rooms in a row with doors of a meter, a pillar in the middle one."""
    occupancy = room(15, 6)
    for x in (5.0, 10.0):
        occupancy = fill(fill(occupancy, x - 0.05, 0, x + 0.05, 6, OCCUPIED), x - 0.1, 2.5, x + 0.1, 3.5, np.uint8(0))
    return fill(occupancy, 7.2, 1.2, 7.6, 1.6, OCCUPIED)


def walk() -> NDArray[np.float64]:
    corners = [(1.5, 1.5), (1.5, 4.5), (3, 3), (7.5, 3), (7.5, 4.6), (8.5, 3), (12, 3), (13.5, 4.5), (13.5, 1.5)]
    parts = [np.linspace(a, b, 12) for a, b in zip(corners[:-1], corners[1:], strict=True)]
    xy = np.concatenate(parts)
    return np.column_stack([xy, np.full(len(xy), 1.2)])


def build(config: MappingConfig) -> BuildResult:
    world = Columns(rooms())
    return build_map(world, walk(), flat_floor, world.support, config, scan="test")


def ways(graph: NavGraph) -> nx.Graph:
    places = {id: v.position[:2] for id, v in graph.viewpoints.items()}
    found = nx.Graph()
    found.add_nodes_from(places)
    found.add_weighted_edges_from((a, b, float(np.hypot(*np.subtract(places[a], places[b])))) for a, b in graph.edges)
    return found


def far_pairs(graph: NavGraph) -> tuple[int, int]:
    """Pairs under 1.5 m with a free way for a robot, and those of them that are over 3 m apart in the graph."""
    occupancy, meters = rooms(), dict(nx.all_pairs_dijkstra_path_length(ways(graph)))
    places = {id: np.array(v.position[:2]) for id, v in graph.viewpoints.items()}
    near = [
        (a, b)
        for a in places
        for b in places
        if a < b and np.hypot(*(places[a] - places[b])) < NEAR and segment_is_free(occupancy, places[a], places[b], 0.3)
    ]
    return len(near), sum(meters[a].get(b, np.inf) > 2 * NEAR for a, b in near)


@pytest.fixture(scope="module")
def settled() -> NavGraph:
    return build(SMALL).graph


def test_near_viewpoints_are_near_in_the_graph_where_lattices_leave_them_far(settled: NavGraph) -> None:
    near, far = far_pairs(build(LATTICES).graph)
    assert far > 0.3 * near > 0, "what is to be mended shows in this world"
    assert far_pairs(settled)[1] == 0


def test_a_settled_graph_hangs_together_and_every_edge_is_free(settled: NavGraph) -> None:
    occupancy = rooms()
    assert nx.is_connected(ways(settled))
    for a, b in settled.edges:
        ends = (np.array(settled.viewpoints[id].position[:2]) for id in (a, b))
        assert segment_is_free(occupancy, *ends, 0.2)
    assert nx.average_clustering(ways(settled)) > 0.25


def test_every_place_of_the_walk_has_a_viewpoint_near(settled: NavGraph) -> None:
    places = np.array([v.position[:2] for v in settled.viewpoints.values()])
    apart = np.hypot(*(walk()[:, None, :2] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() < SMALL.cover_distance


def test_evidence_says_why_a_free_corridor_has_no_edge(settled: NavGraph) -> None:
    words = {e.decision for e in settled.evidence.values()}
    assert {"open", "served", "spare"} <= words
    for e in settled.evidence.values():
        if e.decision == "open":
            leads = e.joins or next(
                id for id, v in settled.viewpoints.items() if np.hypot(*np.subtract(v.position[:2], e.target)) < 0.01
            )
            assert leads in settled.neighbors(e.viewpoint)
        if e.decision == "spare" and e.joins:
            assert e.joins not in settled.neighbors(e.viewpoint)


def test_the_thresholds_that_built_it_change_nothing(settled: NavGraph) -> None:
    redecision = Rethresholder(settled, walk()).decide(SMALL)
    assert not redecision
    assert Rethresholder(settled, walk()).apply(redecision).evidence == settled.evidence


def test_a_build_that_remembers_is_the_same_to_the_last_bit(settled: NavGraph) -> None:
    world = Columns(rooms())
    kept: list[NavGraph] = []
    first = build_map(world, walk(), flat_floor, world.support, SMALL, scan="test", keep=kept.append)
    again = build_map(world, walk(), flat_floor, world.support, SMALL, scan="test", previous=first.graph)
    for other in (first.graph, again.graph):
        assert dict(other.viewpoints) == dict(settled.viewpoints) and dict(other.edges) == dict(settled.edges)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=4, max_size=16, unique=True))
def test_untying_a_grid_keeps_it_together_and_leaves_no_edge_that_could_be_spared(cells: list[tuple[int, int]]) -> None:
    draft = GraphBuilder("test")
    ids = {cell: f"{cell[0]}{cell[1]}" for cell in cells}
    for (x, y), id in ids.items():
        draft.set_viewpoint(Viewpoint(id, (2.0 * x, 2.0 * y, 1.2)))
    found = DraftGraph(draft)
    found.add(ids.values())
    for (x, y), id in ids.items():
        for other in ((x + 1, y), (x, y + 1), (x + 1, y + 1), (x + 1, y - 1)):
            if other in ids:
                found.join(id, ids[other])
    before = {frozenset(c) for c in nx.connected_components(_graph(found))}
    remove_ties(found)
    after = _graph(found)
    assert {frozenset(c) for c in nx.connected_components(after)} == before
    for start in after:
        meters = nx.single_source_dijkstra_path_length(after, start, cutoff=12.0)
        for end in meters:
            last = [n for n in after[end] if n in meters and meters[n] < meters[end]]
            tied = [n for n in last if meters[n] + after[n][end]["weight"] <= meters[end] + SAME_LENGTH]
            assert len(tied) < 2 or not any(found.is_edge_redundant(n, end) for n in tied)


def test_a_way_is_as_long_whatever_is_left_aside_on_the_search_for_it() -> None:
    rng = np.random.default_rng(0)
    draft = GraphBuilder("test")
    for i, (x, y) in enumerate(rng.uniform(0, 12, (90, 2)).tolist()):
        draft.set_viewpoint(Viewpoint(str(i), (x, y, 1.2)))
    found = DraftGraph(draft)
    found.add(draft.viewpoints)
    for a in found:
        for b in found:
            if a < b and found.distance(a, b) < 2.0:
                found.join(a, b)
    for a in found:
        whole = found.path_lengths_from(a, np.inf)
        for b in found:
            far = whole.get(b, np.inf)
            for most in (found.distance(a, b), 0.9 * far, far, 1.2 * found.distance(a, b) + 1):
                assert found.meters(a, b, most) == (far if far <= most else np.inf)


def _graph(found: DraftGraph) -> nx.Graph:
    graph = nx.Graph()
    graph.add_nodes_from(found)
    graph.add_weighted_edges_from((a, b, found.distance(a, b)) for a, b in found.edges())
    return graph


def test_a_nook_in_which_one_can_take_a_step_keeps_its_viewpoints() -> None:
    """Behind a gap too narrow for the robot there is room for two viewpoints less than the merge radius apart."""
    occupancy = fill(room(7, 4), 5.0, 0, 5.1, 4, OCCUPIED)
    occupancy = fill(occupancy, 4.9, 1.8, 5.2, 2.3, np.uint8(0))
    way = np.column_stack([np.linspace(1, 6.4, 40), np.full(40, 2.05), np.full(40, 1.2)])
    world = Columns(occupancy)

    def nook(config: MappingConfig) -> list[str]:
        graph = build_map(world, way, flat_floor, world.support, config, scan="test").graph
        return [id for id, v in graph.viewpoints.items() if v.position[0] > 5.1]

    config = replace(SMALL, merge_radius=2.5, tau_dist=1.0)
    assert len(nook(replace(config, settle=False))) >= 2, "what is to be kept is there"
    assert nook(config)


def test_of_two_near_viewpoints_the_one_that_nobody_reaches_goes() -> None:
    draft = GraphBuilder("test")
    places = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (2.0, 0.0), "alone": (1.0, 0.7)}
    for id, (x, y) in places.items():
        draft.viewpoints[id] = Viewpoint(id, (x, y, 1.2), 1.2, "step")
    found = DraftGraph(draft)
    found.add(places)
    found.join("a", "b")
    found.join("b", "c")
    together = {"a", "b", "c"}
    assert found.parts() == {"a": together, "b": together, "c": together, "alone": {"alone"}}
