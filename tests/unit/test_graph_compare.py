"""Comparing two graphs, merging what is chosen, and the order in which edges are reviewed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.cli.main import main
from nvsim.graph import edits
from nvsim.graph.compare import compare, merge
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.edits import EditError
from nvsim.graph.review import Review, distance
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.explain import smallest_margin

PLACES = {"a": (0.0, 0.0, 1.5), "b": (2.0, 0.0, 1.5), "c": (4.0, 0.0, 1.5), "d": (6.0, 0.0, 1.5)}
PAIRS = [("a", "b"), ("b", "c"), ("c", "d")]
LINE = NavGraph("s", {id: Viewpoint(id, p) for id, p in PLACES.items()}, {k: edge(*k) for k in PAIRS})


def said(a: NavGraph, b: NavGraph) -> set[tuple[str, object]]:
    return {(d.kind, d.edge or d.viewpoint) for d in compare(a, b).deviations}


def test_each_difference_is_named_once() -> None:
    b = edits.remove_edge(LINE, "a", "b")
    b = edits.move_viewpoint(edits.add_edge(b, "b", "d"), "c", (4.0, 1.0, 1.5))
    b = edits.set_included(b, ["a"], False)
    b = edits.place_viewpoint(b, (8, 0, 1.5), id="e")
    expected = {("edge removed", ("a", "b")), ("edge added", ("b", "d")), ("viewpoint moved", "c"),
                ("viewpoint changed", "a"), ("viewpoint added", "e")}  # fmt: skip
    assert said(LINE, b) == expected
    assert ("viewpoint removed", "e") in said(b, LINE)
    assert said(LINE, LINE) == set()


def test_viewpoints_with_other_ids_are_matched_by_place() -> None:
    b = edits.rename_viewpoint(edits.move_viewpoint(LINE, "b", (2.1, 0, 1.5)), "b", "z")
    found = compare(LINE, b)
    assert found.matched["b"] == "z" and found.by_place == ("b",)
    assert [(d.kind, d.viewpoint, round(d.distance, 3)) for d in found.deviations] == [("viewpoint moved", "b", 0.1)]
    far = compare(LINE, b, tolerance=0.05)
    assert far.counts()["viewpoint added"] == far.counts()["viewpoint removed"] == 1
    assert far.counts()["edge added"] == far.counts()["edge removed"] == 2


def test_an_edge_to_a_new_viewpoint_needs_the_viewpoint() -> None:
    b = edits.add_edge(edits.place_viewpoint(LINE, (8, 0, 1.5), id="e"), "d", "e")
    found = compare(LINE, b)
    with pytest.raises(EditError, match="needs viewpoint e"):
        merge(LINE, b, found, [d for d in found.deviations if d.kind == "edge added"])
    assert merge(LINE, b, found, []) is LINE


NAMES = [*PLACES, "e", "f"]
STEPS = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "move", "join", "part", "exclude", "rename"]),
        st.sampled_from(NAMES),
        st.sampled_from(NAMES),
        st.integers(0, 40),
    ),
    max_size=12,
)


def edited(graph: NavGraph, steps: list[tuple[str, str, str, int]]) -> NavGraph:
    for name, a, b, n in steps:
        try:
            if name == "add":
                graph = edits.place_viewpoint(graph, (n, 5, 1.5), id=a)
            elif name == "remove":
                graph = edits.remove_viewpoints(graph, [a])
            elif name == "move":
                graph = edits.move_viewpoint(graph, a, (n / 4, 1, 1.5))
            elif name == "join":
                graph = edits.add_edge(graph, a, b)
            elif name == "part":
                graph = edits.remove_edge(graph, a, b)
            elif name == "exclude":
                graph = edits.set_included(graph, [a], n % 2 == 0)
            else:
                graph = edits.rename_viewpoint(graph, a, f"r{n}")
        except EditError:
            continue
    return graph


@settings(max_examples=150, deadline=None)
@given(STEPS, STEPS)
def test_merging_everything_leaves_no_difference(one: list, other: list) -> None:
    a, b = edited(LINE, one), edited(LINE, other)
    found = compare(a, b)
    merged = merge(a, b, found, found.deviations)
    places = sorted((v.position, v.included) for v in merged.viewpoints.values())
    assert places == sorted((v.position, v.included) for v in b.viewpoints.values())
    ends = sorted(sorted(merged.viewpoints[k].position for k in key) for key in merged.edges)
    assert ends == sorted(sorted(b.viewpoints[k].position for k in key) for key in b.edges)


def test_the_command_compares_checks_and_merges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = write_connectivity(LINE, tmp_path / "a")
    b = write_connectivity(edits.remove_edge(LINE, "c", "d"), tmp_path / "b")
    assert main(["graph", "compare", str(a), str(b), "--json", "--out", str(tmp_path / "m_connectivity.json")]) == 0
    assert json.loads(capsys.readouterr().out)["edge removed"] == 1
    assert read_connectivity(tmp_path / "m_connectivity.json").edges.keys() == {("a", "b"), ("b", "c")}
    assert main(["graph", "check", str(a)]) == 0
    assert "nothing found" in capsys.readouterr().out
    assert main(["graph", "check", str(tmp_path / "b"), "--json"]) == 1
    (scan,) = json.loads(capsys.readouterr().out)
    assert [f["key"] for f in scan["findings"]] == ["isolated/d"] and scan["error"] == 1
    assert main(["graph", "review", str(a), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unreviewed"] == 3


def evidence(a: str, b: str, alpha: float) -> Evidence:
    cells = np.full((29, 18), round(alpha * 255), np.uint8)
    return Evidence(a, 8, 0.0, 2.0, cells, np.full_like(cells, 255), np.ones(cells.shape, bool), 0.05, 0.1, 0.9, 0,
                    PLACES[b][:2], b, "open")  # fmt: skip


def test_the_least_certain_edges_come_first() -> None:
    measured = [evidence("a", "b", 0.02), evidence("b", "c", 0.15)]
    graph = edits.add_edge(replace(LINE, evidence={e.key: e for e in measured}), "b", "d")
    review = Review(smallest_margin(MappingConfig()))
    order = review.order(graph)
    assert [d.edge for d in order] == [("b", "d"), ("c", "d"), ("b", "c"), ("a", "b")]
    assert math.isnan(order[0].margin) and order[2].margin == pytest.approx(0.05, abs=0.003)
    seen = edits.mark_reviewed(graph, edges=[("b", "d"), ("c", "d")])
    assert [d.edge for d in review.order(seen)] == [("b", "c"), ("a", "b")]
    assert review.order(edits.mark_reviewed(seen, edges=list(seen.edges))) == []


def test_an_edge_close_to_the_thresholds_is_not_said_to_be_zero_away() -> None:
    assert [distance(margin) for margin in (0.004, -0.001, 0.006, -0.25)] == [
        "less than 0.01",
        "less than 0.01",
        "0.01",
        "0.25",
    ]
