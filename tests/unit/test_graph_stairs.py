"""Stairs are judged over several edges, and a kind of findings is ignored in a whole graph."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from test_graph_findings import graph_of, keys

from nvsim.graph import edits
from nvsim.graph.findings import Validator, check_graph
from nvsim.graph.findings.elements import flight_slope, slope
from nvsim.graph.paths import count_cut_off
from nvsim.graph.quantities import quantity

FLIGHT = {"a": (0.0, 0.0, 1.0), "b": (1.2, 0.0, 1.4), "c": (1.7, 0.0, 2.1), "d": (3.0, 0.0, 2.8), "e": (5.0, 0.0, 2.8)}
WAYS = [("a", "b"), ("b", "c"), ("c", "d"), ("d", "e")]


def test_one_steep_edge_of_a_gentle_flight_is_no_finding_and_alone_it_is() -> None:
    graph = graph_of(FLIGHT, WAYS)
    assert slope(graph, ("b", "c")) == pytest.approx(np.degrees(np.arctan2(0.7, 0.5)))
    assert flight_slope(graph, ("b", "c")) == pytest.approx(np.degrees(np.arctan2(1.8, 3.0)))
    assert keys(graph) == set()
    alone = edits.remove_edge(edits.remove_edge(graph, "a", "b"), "c", "d")
    assert "steep/b/c" in keys(alone)
    cliff = graph_of({**FLIGHT, "c": (1.4, 0.0, 4.4)}, WAYS)
    assert "steep/b/c" in keys(cliff), "a storey is no step, whatever leads to it"


def test_the_slope_of_a_table_is_that_of_the_finding() -> None:
    graph = graph_of(FLIGHT, WAYS)
    names, values = quantity(graph, "slope", kind="edges")
    assert values == pytest.approx([slope(graph, key) for key in names])


def test_an_edit_beside_a_steep_edge_is_followed() -> None:
    graph = graph_of(FLIGHT, WAYS)
    validator = Validator(graph)
    for pair in (("a", "b"), ("c", "d")):
        graph = edits.remove_edge(graph, *pair)
        validator.update(graph)
        assert set(validator.findings) == keys(graph)
    graph = edits.add_edge(graph, "c", "d")
    validator.update(graph)
    assert set(validator.findings) == keys(graph)


def test_a_kind_is_ignored_in_the_whole_graph() -> None:
    graph = graph_of({"a": (0, 0, 1), "b": (6, 0, 1), "c": (12, 0, 1)}, [("a", "b"), ("b", "c")])
    found = check_graph(graph)
    assert [f.kind for f in found] == ["long", "long"] and not found[0].ignored_by(graph.ignored)
    hall = edits.ignore_finding(graph, found[0].kind_key, "a hall")
    assert all(f.ignored_by(hall.ignored) == "long/*" for f in check_graph(hall))
    assert not any(f.ignored_by(edits.heed_finding(hall, "long/*").ignored) for f in found)


@pytest.mark.parametrize("seed", range(4))
def test_what_an_edge_parts_is_what_networkx_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ids = [f"v{i}" for i in range(14)]
    pairs = {tuple(sorted(rng.choice(ids, 2, replace=False).tolist())) for _ in range(15)}
    graph = graph_of({id: (2.0 * i, 0, 1) for i, id in enumerate(ids)}, sorted(pairs))
    for key in graph.edges:
        slow = nx.Graph(list(graph.edges))
        slow.add_nodes_from(ids)
        slow.remove_edge(*key)
        sides = [nx.node_connected_component(slow, end) for end in key]
        assert count_cut_off(graph, key) == (0 if key[1] in sides[0] else min(map(len, sides)))
