"""The structure of graphs: closed forms, networkx's second-shortest paths, ways around a wall's end."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
import pytest
from columns import fill, room

from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.structure import MapPaths, map_structure
from nvsim.graph.paths import SAME_LENGTH, PathGraph
from nvsim.graph.structure import structure
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.occupancy.grid_ways import ERROR, Geodesics
from nvsim.occupancy.paths import standing_room
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps
from nvsim.occupancy.types import OCCUPIED


def graph_of(places: dict[str, tuple[float, ...]], joined: str = "") -> NavGraph:
    viewpoints = {id: Viewpoint(id, (xyz[0], xyz[1], xyz[2] if len(xyz) > 2 else 1.5)) for id, xyz in places.items()}
    return NavGraph("test", viewpoints, {e.key: e for e in (edge(*pair) for pair in joined.split())})


def square() -> NavGraph:
    return graph_of({"a": (1, 1), "b": (3, 1), "c": (3, 3), "d": (1, 3)}, "ab bc cd ad")


def test_a_square_has_two_ways_across_and_no_triangle() -> None:
    figures = structure(square())
    assert figures["tied"] == pytest.approx(2 / 6, abs=1e-5), "the two diagonals"
    assert figures["clustering"] == 0 and structure(graph_of(PLACES, "ab bc cd ad ac"))["clustering"] > 0.8
    assert (figures["mean_degree"], figures["nearest"], figures["edge_length_max"]) == (2, 2, 2)


PLACES: dict[str, tuple[float, ...]] = {id: v.position for id, v in square().viewpoints.items()}


def test_lengths_are_of_space_and_excluded_viewpoints_do_not_count() -> None:
    graph = graph_of({"a": (0, 0, 1.5), "b": (3, 0, 5.5), "c": (0, 1, 1.5)}, "ab ac")
    assert structure(graph)["edge_length_max"] == 5
    shut = NavGraph("test", {**graph.viewpoints, "b": Viewpoint("b", (3, 0, 5.5), included=False)}, graph.edges)
    assert structure(shut)["edge_length_max"] == 1 and structure(shut)["mean_degree"] == 1


def test_two_graphs_are_pooled() -> None:
    alone = graph_of({"a": (0, 0), "b": (1, 0)}, "ab")
    figures = structure([square(), alone])
    assert figures["tied"] == pytest.approx(2 / 7, abs=1e-5)
    assert figures["mean_degree"] == pytest.approx(10 / 6, abs=5e-3)
    assert set(structure(NavGraph("test")).values()) == {0}


@pytest.mark.parametrize("seed", range(4))
def test_ties_are_those_that_a_list_of_shortest_paths_has(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"v{i}" for i in range(24)]
    # A lattice with a little noise has ties within a centimeter, and others just beyond it.
    places = {n: (i % 6 + rng.normal(0, 0.003), i // 6 + rng.normal(0, 0.003)) for i, n in enumerate(names)}
    near = [p for p in itertools.combinations(names, 2) if math.dist(places[p[0]], places[p[1]]) < 1.5]
    kept = [p for p in near if rng.random() < 0.7]
    viewpoints = {n: Viewpoint(n, (*xy, 1.5)) for n, xy in places.items()}
    graph = NavGraph("test", viewpoints, {e.key: e for e in (edge(*p) for p in kept)})
    reference = nx.Graph()
    reference.add_nodes_from(names)
    reference.add_weighted_edges_from((a, b, math.dist(places[a], places[b])) for a, b in kept)
    ways, found, expected = PathGraph.of(graph), [], []
    for i, a in enumerate(names):
        far, edges, second = ways.shortest_paths_with_ties(i)
        for j, b in enumerate(names):
            if i == j:
                continue
            if not nx.has_path(reference, a, b):
                assert math.isinf(far[j])
                continue
            paths = list(itertools.islice(nx.shortest_simple_paths(reference, a, b, "weight"), 2))
            lengths = [nx.path_weight(reference, p, "weight") for p in paths]
            assert far[j] == pytest.approx(lengths[0]) and edges[j] == len(paths[0]) - 1
            found.append(bool(second[j]))
            expected.append(len(paths) > 1 and lengths[1] - lengths[0] <= SAME_LENGTH)
    assert found == expected and 0 < sum(expected) < len(expected)


def test_a_way_over_the_map_goes_around_the_end_of_a_wall() -> None:
    occupancy = fill(room(6, 4), 2.95, 1.0, 3.05, 4, OCCUPIED)
    ways = Geodesics(standing_room(occupancy), occupancy)
    rng = np.random.default_rng(0)
    for _ in range(40):
        a, b = rng.uniform([0.5, 1.2], [2.8, 3.8]), rng.uniform([3.2, 1.2], [5.5, 3.8])
        left, right = np.array([2.95, 1.0]), np.array([3.05, 1.0])
        true = np.linalg.norm(a - left) + 0.1 + np.linalg.norm(right - b)
        found = float(ways.lengths(a, b[None])[0])
        assert true - 0.1 <= found <= true * (1 + ERROR) + 2 * occupancy.resolution
    straight, wall, outside = ways.lengths(np.array([1.0, 0.5]), np.array([[5.0, 0.7], [3.0, 2.0], [-9.0, 0.0]]))
    assert straight == pytest.approx(math.hypot(4, 0.2)) and math.isnan(wall) and math.isnan(outside)
    closed = fill(room(6, 4), 2.95, 0, 3.05, 4, OCCUPIED)
    apart = Geodesics(standing_room(closed), closed).lengths(np.array([1.0, 1.0]), np.array([[5.0, 1.0]]))
    assert math.isinf(apart[0])


def test_near_viewpoints_are_far_apart_when_only_a_long_way_joins_them() -> None:
    places = {"a": (1, 1), "b": (1, 2), "c": (5, 1), "d": (5, 2)}
    figures = map_structure(graph_of(places, "ac cd bd"), room(6, 4))
    assert (figures["near_pairs_1.5"], figures["near_far_1.5"]) == (2, 0.5), "ab, not cd"
    walled = fill(room(6, 4), 0, 1.45, 2, 1.55, OCCUPIED)
    assert map_structure(graph_of(places, "ac cd bd"), walled)["near_pairs_1.5"] == 1, "no straight way"
    storeys = {**places, "b": (1.0, 1.5, 2.6)}
    assert map_structure(graph_of(storeys, "ac cd"), room(6, 4))["near_pairs_1.5"] == 1, "another floor"


def test_detour_is_the_way_along_the_graph_over_the_way_on_the_map() -> None:
    places = {"a": (1, 1), "b": (1, 3), "c": (5, 3)}
    figures = map_structure(graph_of(places, "ab bc"), room(6, 4))
    assert figures["detour"] == pytest.approx(1, abs=1e-3) and figures["unreachable"] == 0
    assert figures["detour_p95"] == pytest.approx(6 / math.hypot(4, 2), abs=1e-3), "a third of the pairs cut the corner"
    parted = map_structure(graph_of(places, "ab"), room(6, 4))
    assert parted["unreachable"] == pytest.approx(4 / 6, abs=1e-5) and parted["detour"] == 1
    empty = map_structure(NavGraph("test"), room(4, 4))
    assert set(empty.values()) == {0}


def test_ways_between_storeys_lead_over_the_middles_of_their_stairs() -> None:
    def stair(lower: int, x: float) -> Stair:
        return Stair(lower, lower + 1, ((x, 1.0), (x + 4, 1.0), (x + 4, 3.0), (x, 3.0)))

    maps = StoreyMaps(tuple(StoreyMap(3.0 * k, room(12, 4)) for k in range(3)), (stair(0, 1.0), stair(1, 7.0)))
    places = np.array([[1.0, 2.0], [2.0, 2.0], [6.0, 2.0], [11.0, 2.0], [6.0, 2.0]])
    ways = MapPaths.of(maps, places, np.array([0.0, 0.1, 2.9, 6.0, 9.5]), 0.25)
    assert ways.storeys.tolist() == [0, 0, 1, 2, 2] and ways.can_stand().all()
    found = ways.lengths(np.array([0, 3]), np.arange(5))
    climb = 1.0  # hypot(4, 3) - 4
    expected = [[0, 1, 2 + 3 + climb, 2 + 6 + 2 + 2 * climb, 2 + 6 + 3 + 2 * climb], [0, 0, 3 + 2 + climb, 0, 5]]
    expected[1][:2] = [10 + 2 * climb, 9 + 2 * climb]
    np.testing.assert_allclose(found, expected, atol=0.1)
    assert ways.straight(np.array([[0, 1], [1, 2], [2, 4]])).tolist() == [True, False, False]
    closed = StoreyMaps(maps.storeys, maps.stairs[:1])
    assert np.isinf(
        MapPaths.of(closed, places, np.array([0.0, 0.1, 2.9, 6.0, 9.5]), 0.25).lengths(*np.array([[0], [3]]))
    )


def test_the_figures_of_a_graph_hold_its_structure() -> None:
    figures = evaluate_graph(square(), room(4, 4), np.array([[1.0, 1.0]]))
    assert figures["tied"] > 0 and figures["detour"] == 1 and figures["mean_degree"] == 2
