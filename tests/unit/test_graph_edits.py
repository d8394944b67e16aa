"""Edits, differences, checks and storage of graphs."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.graph.difference import difference
from nvsim.graph.edits import (
    EditError,
    add_edge,
    add_viewpoint,
    move_viewpoint,
    place_viewpoint,
    remove_edge,
    remove_viewpoints,
)
from nvsim.graph.findings import check_graph
from nvsim.graph.paths import components
from nvsim.graph.store import (
    decode_evidence,
    decode_graph,
    encode_evidence,
    encode_graph,
    same_evidence,
    same_graph,
)
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge


def evidence(viewpoint: str, direction: int, joins: str = "", seed: int = 0) -> Evidence:
    rng = np.random.default_rng(seed)
    cells = [rng.integers(0, 256, (29, 18)).astype(np.uint8) for _ in range(2)]
    support = rng.uniform(size=(29, 18)) < 0.5
    return Evidence(viewpoint, direction, 0.1, 2.5, *cells, support, 0.05, 0.1, 0.9, 1, (1 / 3, -2.0), joins, "open")


def sample() -> NavGraph:
    viewpoints = {id: Viewpoint(id, (float(i), i / 3, 1.5)) for i, id in enumerate("abcd")}
    edges = {e.key: e for e in (edge("a", "b"), edge("b", "c"), edge("c", "d", "merge"))}
    found = {e.key: e for e in (evidence("a", 0), evidence("b", 8, "c", 1), evidence("c", 8, "b", 2))}
    return NavGraph("scan", viewpoints, edges, found)


def assert_whole(graph: NavGraph) -> None:
    assert all(id == v.id for id, v in graph.viewpoints.items())
    assert all((e.a, e.b) == key and e.a < e.b for key, e in graph.edges.items())
    assert all(end in graph.viewpoints for key in graph.edges for end in key)
    for key, e in graph.evidence.items():
        assert e.key == key and e.viewpoint in graph.viewpoints and (not e.joins or e.joins in graph.viewpoints)


def test_removing_a_viewpoint_takes_its_edges_and_evidence_and_nothing_else() -> None:
    before = sample()
    after = remove_viewpoints(before, ["c"])
    assert list(after.viewpoints) == ["a", "b", "d"] and list(after.edges) == [("a", "b")]
    assert list(after.evidence) == [("a", 0)]
    assert len(before.viewpoints) == 4, "the graph before is untouched"


def test_moved_viewpoint_is_a_persons_and_what_was_measured_is_stale() -> None:
    after = move_viewpoint(sample(), "b", (9.0, 9.0, 1.5))
    assert after.viewpoints["b"].origin == "person" and after.viewpoints["b"].position == (9.0, 9.0, 1.5)
    assert {key: e.origin for key, e in after.edges.items()} == {
        ("a", "b"): "person",
        ("b", "c"): "person",
        ("c", "d"): "merge",
    }
    assert {key: e.stale for key, e in after.evidence.items()} == {("a", 0): False, ("b", 8): True, ("c", 8): True}


@pytest.mark.parametrize(
    "edit",
    [
        lambda g: add_viewpoint(g, Viewpoint("a", (0, 0, 0))),
        lambda g: add_viewpoint(g, Viewpoint("x/y", (0, 0, 0))),
        lambda g: add_viewpoint(g, Viewpoint("x", (0, float("nan"), 0))),
        lambda g: place_viewpoint(g, (9, 0, 0), height=-1.5),
        lambda g: remove_viewpoints(g, ["a", "z"]),
        lambda g: add_edge(g, "a", "b"),
        lambda g: add_edge(g, "b", "a"),
        lambda g: add_edge(g, "a", "a"),
        lambda g: add_edge(g, "a", "z"),
        lambda g: remove_edge(g, "a", "c"),
        lambda g: move_viewpoint(g, "z", (0, 0, 0)),
    ],
)
def test_impossible_edits_say_why(edit: object) -> None:
    with pytest.raises(EditError, match=r"\.$"):
        edit(sample())  # type: ignore[operator]


EDITS = st.lists(
    st.tuples(st.sampled_from(["add", "remove", "join", "cut", "move"]), *(2 * [st.sampled_from("abcdefg")])),
    max_size=25,
)


@settings(deadline=None)
@given(EDITS)
def test_any_sequence_of_edits_keeps_the_graph_whole(edits: list[tuple[str, str, str]]) -> None:
    graph = sample()
    for kind, a, b in edits:
        before = graph
        try:
            if kind == "add":
                graph = add_viewpoint(graph, Viewpoint(a, (ord(b) - 97.0, 1.0, 1.5), origin="person"))
            elif kind == "remove":
                graph = remove_viewpoints(graph, {a, b})
            elif kind == "join":
                graph = add_edge(graph, a, b)
            elif kind == "cut":
                graph = remove_edge(graph, a, b)
            else:
                graph = move_viewpoint(graph, a, (5.0, ord(b) - 97.0, 1.5))
        except EditError:
            assert graph is before
        assert_whole(graph)
        found = difference(before, graph)
        assert set(graph.viewpoints) == set(before.viewpoints) - set(found.removed_viewpoints) | set(
            found.added_viewpoints
        )
        assert set(graph.edges) == set(before.edges) - set(found.removed_edges) | set(found.added_edges)
        assert all(graph.viewpoints[id] != before.viewpoints[id] for id in found.changed_viewpoints)
    assert same_graph(decode_graph(encode_graph(graph)), graph)


def test_adding_and_cutting_an_edge_differ_by_that_edge() -> None:
    before = sample()
    after = add_edge(before, "d", "a")
    assert difference(before, after).added_edges == (("a", "d"),)
    assert difference(after, before).removed_edges == (("a", "d"),)
    assert not difference(before, remove_edge(after, "a", "d"))


def test_evidence_comes_back_equal_and_small() -> None:
    found = evidence("a" * 32, 3)
    assert same_evidence(decode_evidence(encode_evidence(found)), found)
    clear = Evidence(
        "a" * 32, 0, 0.13, 2.5, *2 * [np.zeros((29, 18), np.uint8)], np.ones((29, 18), bool), *3 * [0.1], 0, (1, 2)
    )
    assert len(encode_evidence(clear)) < 500


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.binary(max_size=3))
def test_torn_blobs_are_refused(cut: int, noise: bytes) -> None:
    for blob, decode in ((encode_evidence(evidence("a", 0)), decode_evidence), (encode_graph(sample()), decode_graph)):
        at = cut % len(blob)
        with pytest.raises(InputError):
            decode(blob[:at] + noise if blob[:at] + noise != blob else b"")  # type: ignore[operator]


def test_blobs_of_a_newer_version_are_refused() -> None:
    blob = encode_evidence(evidence("a", 0))
    with pytest.raises(InputError, match="newer"):
        decode_evidence(struct.pack("<B", 4) + blob[1:])


def test_equal_graphs_are_equal_bytes() -> None:
    assert encode_graph(sample()) == encode_graph(sample())
    changed = NavGraph("scan", sample().viewpoints, sample().edges, {("a", 0): evidence("a", 0, seed=5)})
    assert not same_graph(changed, sample())


def test_checks_find_what_agents_trip_over() -> None:
    places = {"a": (0, 0), "b": (2, 0), "c": (2.1, 0), "d": (20, 0), "e": (22, 0), "f": (40, 0), "g": (47, 0)}
    viewpoints = {id: Viewpoint(id, (*xy, 1.5)) for id, xy in places.items()}
    viewpoints["h"] = Viewpoint("h", (60, 0, 1.5), included=False)
    edges = {e.key: e for e in (edge("a", "b"), edge("b", "c"), edge("d", "e"), edge("e", "g"))}
    found = {(f.kind, f.viewpoints) for f in check_graph(NavGraph("s", viewpoints, edges))}
    assert found == {
        ("isolated", ("f",)),
        ("island", ("d", "e", "g")),
        ("duplicate", ("b", "c")),
        ("long", ("e", "g")),
    }
    assert components(NavGraph("s", viewpoints, edges)) == [["a", "b", "c"], ["d", "e", "g"], ["f"]]
