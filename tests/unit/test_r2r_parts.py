"""A large graph is cut where few edges join its halves."""

from __future__ import annotations

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_samples import two_rooms

from nvsim.errors import InputError
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.observations.parts import split


def lattices(rooms: int, side: int) -> NavGraph:
    """Square lattices in a row, neighbors joined by one edge: a door."""
    viewpoints, edges = {}, []
    for room in range(rooms):
        for i in range(side):
            for j in range(side):
                id = f"{room}.{i}.{j}"
                viewpoints[id] = Viewpoint(id, (room * (side + 2.0) + i, float(j), 1.5))
                edges += [(f"{room}.{i - 1}.{j}", id)] * (i > 0) + [(f"{room}.{i}.{j - 1}", id)] * (j > 0)
        edges += [(f"{room - 1}.{side - 1}.0", f"{room}.0.0")] * (room > 0)
    return NavGraph("house", viewpoints, {edge(*pair).key: edge(*pair) for pair in edges})


@pytest.mark.parametrize("most", [36, 40, 80, 120])
def test_lattices_are_cut_at_their_doors(most):
    graph = lattices(6, 6)
    parts = split(graph, most)
    for part in parts:
        rooms = {id.split(".")[0] for id in part.viewpoints}
        assert len(part.viewpoints) == 36 * len(rooms) <= most, "a room stays whole"
    assert len(graph.edges) - sum(len(p.edges) for p in parts) == len(parts) - 1


def test_a_graph_that_is_small_enough_stays_one():
    graph = two_rooms(5, 5)
    assert split(graph, 10) == [graph]


def test_names_go_on_after_z():
    names = [part.scan for part in split(lattices(30, 4), 16)]
    assert names == [f"house-{chr(97 + i)}" for i in range(26)] + ["house-aa", "house-ab", "house-ac", "house-ad"]


def test_islands_are_no_scans_of_their_own():
    graph = two_rooms(12, 12)
    lonely = {f"9{i:031d}": Viewpoint(f"9{i:031d}", (float(i), 20.0, 1.5)) for i in range(3)}
    parts = split(NavGraph("house", {**graph.viewpoints, **lonely}, graph.edges), 20)
    assert sorted(len(p.viewpoints) for p in parts) == [12, 15]


def test_too_small_a_limit_is_refused():
    with pytest.raises(InputError, match="--max-viewpoints"):
        split(two_rooms(5, 5), 3)


@settings(deadline=None, max_examples=40)
@given(st.integers(20, 120), st.integers(1, 10**6), st.integers(10, 40))
def test_parts_hold_every_viewpoint_once_and_are_the_same_each_time(count, seed, most):
    tree = nx.random_geometric_graph(count, 0.2, seed=seed)
    viewpoints = {f"{i:03d}": Viewpoint(f"{i:03d}", (float(i), 0.0, 1.5)) for i in range(count)}
    graph = NavGraph("g", viewpoints, {(f"{a:03d}", f"{b:03d}"): edge(f"{a:03d}", f"{b:03d}") for a, b in tree.edges})
    parts = split(graph, most)
    assert sorted(id for p in parts for id in p.viewpoints) == sorted(viewpoints)
    assert all(len(p.viewpoints) <= most and set(p.edges) <= set(graph.edges) for p in parts)
    assert [list(p.viewpoints) for p in parts] == [list(p.viewpoints) for p in split(graph, most)]
