"""Edits of a user remain after the map is decided again."""

from __future__ import annotations

from nvsim.graph import edits
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.mapping.search.graph_builder import keep_edits


def test_what_a_person_made_marked_and_locked_is_kept() -> None:
    viewpoints = {id: Viewpoint(id, (float(i), 0.0, 1.5)) for i, id in enumerate("abcd")}
    made = {e.key: e for e in (edge("a", "b"), edge("b", "c"), edge("c", "d"))}
    machine = NavGraph("scan", viewpoints, made)
    previous = edits.place_viewpoint(machine, (9.0, 9.0, 1.5), id="mine")
    previous = edits.add_edges(previous, [("mine", "a"), ("mine", "d")])
    previous = edits.mark_reviewed(previous, ["a"], [("a", "b")])
    previous = edits.set_locked(previous, ["c"], [("b", "c")])
    previous = edits.ignore_finding(previous, "long a b", "a ramp")
    again = keep_edits(edits.remove_viewpoints(machine, ["c", "d"]), previous)
    assert list(again.viewpoints) == ["a", "b", "c", "mine"] and again.viewpoints["c"].locked
    assert again.viewpoints["a"].reviewed and again.edges["a", "b"].reviewed and not again.viewpoints["b"].reviewed
    assert set(again.edges) == {("a", "b"), ("b", "c"), ("a", "mine")}
    assert again.ignored == {"long a b": "a ramp"}
    assert keep_edits(machine, None) is machine
