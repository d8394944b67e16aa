"""Proposals: edges where the way is free and today's is long, viewpoints where floor is not seen."""

from __future__ import annotations

import json
import math
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from nvsim.cli.main import main
from nvsim.graph import edits
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.proposals import propose_edges, propose_viewpoints
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.paths import reachable, segment_is_free, visible
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap


def hall(width: float = 12.0, depth: float = 6.0) -> OccupancyMap:
    """An empty hall with walls, a decimeter to a cell, its inner corner at the origin."""
    cells = np.full((round(depth * 10) + 2, round(width * 10) + 2), OCCUPIED, np.uint8)
    cells[1:-1, 1:-1] = FREE
    return OccupancyMap(cells, 0.1, (-0.1, -0.1))


def with_wall(occupancy: OccupancyMap, x: float, low: float, high: float, state: np.uint8 = OCCUPIED) -> OccupancyMap:
    cells = occupancy.cells.copy()
    (r0, c), (r1, _) = occupancy.index(np.array([[x, low], [x, high]]))
    cells[r0:r1, c] = state
    return OccupancyMap(cells, occupancy.resolution, occupancy.origin)


def graph_of(places: dict[str, tuple[float, ...]], *pairs: str) -> NavGraph:
    viewpoints = {id: Viewpoint(id, (xyz[0], xyz[1], xyz[2] if len(xyz) > 2 else 1.5)) for id, xyz in places.items()}
    return NavGraph("hall", viewpoints, {e.key: e for e in (edge(*pair) for pair in pairs)})


def test_an_edge_is_proposed_over_free_floor_and_not_through_a_wall() -> None:
    graph = graph_of({"a": (2, 3), "b": (4.5, 3), "c": (7, 3)})
    assert [p.edge for p in propose_edges(graph, hall())] == [("a", "b"), ("b", "c")]
    assert [p.edge for p in propose_edges(graph, with_wall(hall(), 3, 0, 6))] == [("b", "c")]
    assert [p.edge for p in propose_edges(graph, with_wall(hall(), 3, 2, 4, UNKNOWN))] == [("b", "c")]
    assert propose_edges(graph) == ()


def test_a_gap_narrower_than_the_robot_lets_no_edge_pass() -> None:
    graph = graph_of({"a": (2, 3), "b": (4.5, 3)})
    for gap, passes in ((0.4, False), (1.0, True)):
        occupancy = with_wall(with_wall(hall(), 3, 0, 3 - gap / 2), 3, 3 + gap / 2, 6)
        assert bool(propose_edges(graph, occupancy, radius=0.25)) == passes


def test_evidence_against_an_edge_outweighs_the_map() -> None:
    graph = graph_of({"a": (2, 3), "b": (4.5, 3)})
    graph = NavGraph(graph.scan, graph.viewpoints, graph.edges, {("a", 0): measured("a")})
    free, walled = hall(), with_wall(hall(), 3, 0, 6)
    for slack, occupancy, proposed in (
        (0.2, free, True),
        (0.2, None, True),
        (0.2, walled, False),
        (-0.1, free, False),
        (math.nan, free, True),
        (math.nan, None, False),
    ):
        found = propose_edges(graph, occupancy, lambda g, key, slack=slack: slack)
        assert bool(found) == proposed, (slack, occupancy)
    one, both = (propose_edges(graph, m, lambda g, key: 0.2)[0].score for m in (None, free))
    assert both > one


def measured(id: str) -> Evidence:
    cells = np.zeros((2, 2), np.uint8)
    return Evidence(id, 0, 0.0, 2.5, cells, cells, cells > 0, 0.1, 0.1, 0.6, 0, (2.0, 5.5))


def test_what_joins_two_parts_comes_before_what_shortens_a_way() -> None:
    # A horseshoe a-b-c-d whose ends are near, and e beside it that nothing joins.
    graph = graph_of({"a": (2, 2), "b": (4, 2), "c": (4, 4), "d": (2, 4), "e": (6.5, 2)}, "ab", "bc", "cd")
    found = propose_edges(graph, hall(), reach=2.6)
    assert [p.edge for p in found] == [("b", "e"), ("a", "d")]
    assert "no path joins them" in found[0].words and math.isinf(found[0].today)
    assert found[1].today == pytest.approx(6.0) and "6.0 m" in found[1].words


def test_proposals_make_a_spanner_of_all_free_pairs_with_few_edges() -> None:
    rng = np.random.default_rng(4)
    places = {f"v{i:03d}": tuple(xy) for i, xy in enumerate(rng.uniform([0.5, 0.5], [11.5, 5.5], (60, 2)).tolist())}
    graph, occupancy = graph_of(places), with_wall(hall(), 6, 0, 4)
    found = propose_edges(graph, occupancy, reach=2.5)
    taken = nx.Graph()
    for p in found:
        taken.add_edge(*p.edge, weight=p.length)
    free = [
        (a, b, math.dist(places[a], places[b]))
        for a in places
        for b in places
        if a < b
        and math.dist(places[a], places[b]) <= 2.5
        and segment_is_free(occupancy, np.array(places[a]), np.array(places[b]), 0.25)
    ]
    assert len(found) < len(free) / 3
    for a, b, length in free:
        assert nx.dijkstra_path_length(taken, a, b) <= 1.5 * length + 1e-9


def test_excluded_viewpoints_and_other_floors_are_left_alone() -> None:
    graph = graph_of({"a": (2, 3), "b": (4.5, 3), "up": (2, 3.5, 3.2)})
    assert [p.edge for p in propose_edges(graph, hall())] == [("a", "b")]
    assert propose_edges(edits.set_included(graph, ["b"], False), hall()) == ()


def test_a_viewpoint_is_proposed_in_a_room_without_viewpoints() -> None:
    occupancy = with_wall(hall(), 6, 0.0, 5.0)  # the way to the right half leads past its upper end
    graph = graph_of({"a": (2, 3), "b": (4.5, 3)}, "ab")
    found = propose_viewpoints(graph, occupancy, sees=4.0)
    assert found and found[0].position[0] > 6 and found[0].position[2] == 1.5
    assert found[0].gain == max(p.gain for p in found)
    assert all("m²" in p.words for p in found)


def test_the_gain_is_what_nothing_else_sees_and_places_stand_free() -> None:
    occupancy = with_wall(hall(), 6, 0.0, 5.0)
    graph = graph_of({"a": (2, 3)})
    seen = visible(occupancy, np.array([2.0, 3.0]), 3.0)
    missing = reachable(occupancy, np.array([[2.0, 3.0]]), 0.25) & ~seen
    known = {id: v.position for id, v in graph.viewpoints.items()}
    for p in propose_viewpoints(graph, occupancy, sees=3.0):
        more = visible(occupancy, np.array(p.position[:2]), 3.0) & missing
        assert p.gain == pytest.approx(more.sum() * 0.01, rel=0.1, abs=0.25)
        missing &= ~more
        assert segment_is_free(occupancy, np.array(p.position[:2]), np.array(p.position[:2]), 0.25)
        for id in p.joins:
            other = np.array(known[id][:2])
            assert segment_is_free(occupancy, np.array(p.position[:2]), other, 0.25)
        known[p.new_id] = p.position
    assert missing.sum() * 0.01 < 1.5, "what is left are corners"
    assert len(known) > 2 and p.joins, "places lean on places before them"


def test_nothing_is_proposed_where_everything_is_seen_or_cannot_be_reached() -> None:
    graph = graph_of({"a": (2, 3), "b": (4.5, 3)}, "ab")
    assert propose_viewpoints(graph, with_wall(hall(), 6, 0, 6), sees=7.0) == ()
    assert propose_viewpoints(graph_of({}), hall()) == ()


def test_the_command_writes_a_script_that_replay_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    occupancy = with_wall(hall(), 6, 0.0, 5.0)
    path = write_connectivity(graph_of({"a": (2, 3), "b": (4.5, 3)}), tmp_path)
    write_ros_map(occupancy, tmp_path / "map.yaml")
    assert main(["graph", "propose", str(path), "--json"]) == 0
    proposed = json.loads(capsys.readouterr().out)
    assert [e["edge"] for e in proposed["edges"]] == [["a", "b"]] and proposed["edges"][0]["today"] is None
    script = tmp_path / "proposed.jsonl"
    assert main(["graph", "propose", str(path), "--script", str(script)]) == 0
    assert main(["graph", "replay", str(path), str(script)]) == 0
    graph = read_connectivity(path)
    assert len(graph.viewpoints) == 2 + len(proposed["viewpoints"]) > 2
    assert all(graph.neighbors(id) for id in graph.viewpoints)
    capsys.readouterr()
    assert main(["graph", "propose", str(path), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)["viewpoints"], "what was taken is not proposed again"


def test_without_a_map_or_evidence_the_command_says_what_it_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_connectivity(graph_of({"a": (2, 3), "b": (4.5, 3)}), tmp_path)
    assert main(["graph", "propose", str(path)]) == 2
    assert "--occupancy" in capsys.readouterr().err


def test_a_file_s_lists_of_who_sees_whom_propose_edges_where_nothing_else_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_connectivity(graph_of({"a": (2, 3), "b": (4.5, 3), "c": (2, 5.5)}), tmp_path)
    data = json.loads(path.read_text())
    index = {entry["image_id"]: i for i, entry in enumerate(data)}
    data[index["b"]]["visible"][index["a"]] = True
    path.write_text(json.dumps(data))
    assert main(["graph", "propose", str(path), "--json"]) == 0
    (edge,) = json.loads(capsys.readouterr().out)["edges"]
    assert sorted(edge["edge"]) == ["a", "b"] and edge["score"] < 0.5 and "lists of the file" in edge["words"]
