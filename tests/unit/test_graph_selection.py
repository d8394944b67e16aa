"""Selecting: by expression, by range, by place, along the graph."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.graph.edits import EditError, mark_reviewed, set_included
from nvsim.graph.expression import by_expression
from nvsim.graph.quantities import QuantityInputs, quantity
from nvsim.graph.selection import (
    NOTHING,
    component,
    existing_part,
    inverted,
    path_between,
    select_everything,
    select_within,
    selection,
    shortest_path,
    with_neighbors,
)
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap


def crossing() -> NavGraph:
    """A cross of four arms of two viewpoints about m, 2 m apart, and a pair far away."""
    places = {"m": (0.0, 0.0)}
    for arm, (x, y) in {"n": (0, 2), "e": (2, 0), "s": (0, -2), "w": (-2, 0)}.items():
        places |= {f"{arm}1": (float(x), float(y)), f"{arm}2": (2.0 * x, 2.0 * y)}
    places |= {"far1": (20.0, 0.0), "far2": (22.0, 0.0)}
    viewpoints = {id: Viewpoint(id, (x, y, 1.5), submap=int(x > 0)) for id, (x, y) in places.items()}
    made = [edge("m", f"{arm}1") for arm in "nesw"] + [edge(f"{arm}1", f"{arm}2", "merge") for arm in "nesw"]
    made += [edge("n2", "e2", "person"), edge("far1", "far2")]
    return NavGraph("cross", viewpoints, {e.key: e for e in made})


@pytest.mark.parametrize(
    ("text", "viewpoints", "edges"),
    [
        ("degree > 3", {"m"}, set()),
        ("degree == 1 and not x > 10", {"s2", "w2"}, set()),
        ("component == 1 and degree > 0", {"far1", "far2"}, set()),
        ("length > 2.5", set(), {("e2", "n2")}),
        ("2 < length <= 6", set(), {("e2", "n2")}),
        ('origin == "person"', set(), {("e2", "n2")}),
        ("x > 15", {"far1", "far2"}, {("far1", "far2")}),
        ("origin in ('person', 'merge') and abs(x) + abs(y) < 3.5 and slope < 1", set(),
         {("n1", "n2"), ("e1", "e2"), ("s1", "s2"), ("w1", "w2")}),
        ("id == 'm' or -x > 3.5", {"m", "w2"}, set()),
        ("evidence < 0.5", set(), set()),
    ],
)  # fmt: skip
def test_expression_selects(text: str, viewpoints: set[str], edges: set[tuple[str, str]]) -> None:
    assert by_expression(crossing(), text) == selection(viewpoints, edges)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("degree >", "not a valid expression"),
        ("__import__('os')", "no quantity '__import__'"),
        ("degree.real > 1", "is not allowed"),
        ("[x for x in (1,)]", "is not allowed"),
        ("colour == 3", "no quantity 'colour'"),
        ("degree", "not a condition"),
        ("degree and reviewed", "not a condition"),
        ("origin > 3", "different types"),
        ("-origin == 3", "different types"),
        ("degree > 2 and length > 2", "No viewpoint and no edge has all"),
        ("validity < 1", "there is none"),
        ("x in 3", "after `in`"),
        ("x ** 2 > 3", "is not allowed"),
        ("not " * 600 + "reviewed", "longer than"),
        ("(" * 900 + "x" + ")" * 900, "not a valid expression"),
    ],
)
def test_expression_refuses_in_a_sentence(text: str, message: str) -> None:
    with pytest.raises(EditError, match=message):
        by_expression(crossing(), text)


@given(st.text(alphabet="degr x>=<()andot 1.5'\"[]+-*/,length", max_size=30))
@settings(max_examples=200, deadline=None)
def test_no_expression_does_anything_but_select_or_be_refused(text: str) -> None:
    graph = crossing()
    try:
        assert existing_part(graph, by_expression(graph, text)) is not NOTHING or True
    except EditError as error:
        assert len(str(error)) > 10


def test_a_quantity_of_edges_has_a_value_per_edge() -> None:
    graph = crossing()
    ids, values = quantity(graph, "length")
    assert ids == tuple(graph.edges) and values[0] == 2.0


def test_evidence_of_an_edge_is_what_was_measured_along_it_and_is_not_stale() -> None:
    graph = crossing()
    alpha = np.full((4, 3), 51, np.uint8)
    alpha[2] = 153
    measured = Evidence("m", 0, 0.0, 2.0, alpha, alpha, alpha > 0, 0.0, 0.1, 0.9, 0, (0.001, 2.0))
    back = replace(measured, viewpoint="n1", direction=8, target=(9.0, 9.0), joins="m", alpha=alpha // 3)
    graph = replace(graph, evidence={e.key: e for e in (measured, back)})
    alphas = dict(zip(*quantity(graph, "alpha"), strict=True))
    assert alphas["m", "n1"] == pytest.approx(0.6) and math.isnan(alphas["e1", "m"])
    assert by_expression(graph, "alpha > 0.5") == selection(edges=[("m", "n1")])
    stale = replace(graph, evidence={e.key: replace(e, stale=e is measured) for e in (measured, back)})
    assert dict(zip(*quantity(stale, "alpha"), strict=True))["m", "n1"] == pytest.approx(0.2)
    least = dict(zip(*quantity(graph, "evidence", kind="viewpoints"), strict=True))
    assert least["m"] == least["n1"] == pytest.approx(0.4) and math.isnan(least["s2"])


def test_validity_is_read_from_the_map() -> None:
    cells = np.full((60, 60), FREE, np.uint8)
    cells[30, 35] = OCCUPIED  # x 0.5 to 0.6, y 0 to 0.1: between m and e1
    known = QuantityInputs(OccupancyMap(cells, 0.1, (-3.0, -3.0)))
    graph = crossing()
    assert ("e1", "m") in by_expression(graph, "validity < 1", known, "edges").edges
    assert ("m", "n1") not in by_expression(graph, "validity < 1", known, "edges").edges
    assert by_expression(graph, "validity == 0 and x < 10", known, "viewpoints").viewpoints == {"n2", "e2", "s2", "w2"}


def test_selection_grows_inverts_and_spreads_over_the_component() -> None:
    graph = crossing()
    assert with_neighbors(graph, selection(["n1"])) == selection(["n1", "n2", "m"])
    assert with_neighbors(graph, selection(edges=[("n1", "n2")])).viewpoints == {"n1", "n2"}
    assert with_neighbors(graph, selection(["m"], [("m", "n1")])).edges == {("m", f"{a}1") for a in "n"} | {
        (f"{a}1", "m") if f"{a}1" < "m" else ("m", f"{a}1") for a in "esw"
    }
    assert inverted(graph, selection(["far1"])).viewpoints == frozenset(graph.viewpoints) - {"far1"}
    assert inverted(graph, NOTHING) == select_everything(graph)
    assert component(graph, ["far1"]) == selection(["far1", "far2"], [("far1", "far2")])
    assert selection(["a"]) | selection(["b"]) == selection(["a", "b"])
    assert selection(["a", "b"]) ^ selection(["b", "c"]) == selection(["a", "c"])


def test_shortest_path_goes_by_meters_and_round_what_is_excluded() -> None:
    graph = crossing()
    assert shortest_path(graph, "n2", "e1") == ("n2", "n1", "m", "e1")
    assert path_between(graph, "n2", "e1").edges == {("n1", "n2"), ("m", "n1"), ("e1", "m")}
    assert shortest_path(set_included(graph, ["m"], False), "n2", "e1") == ("n2", "e2", "e1")
    with pytest.raises(EditError, match="No path"):
        path_between(graph, "m", "far1")
    with pytest.raises(EditError, match="no viewpoint nobody"):
        path_between(graph, "m", "nobody")


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=7), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_lasso_agrees_with_opencv(corners: list[tuple[float, float]], seed: int) -> None:
    import cv2

    points = np.random.default_rng(seed).uniform(-5, 5, (40, 2))
    viewpoints = {str(i): Viewpoint(str(i), (x, y, 1.0)) for i, (x, y) in enumerate(points.tolist())}
    chosen = select_within(NavGraph("s", viewpoints), corners).viewpoints
    # A picture of the polygon, filled by the even-odd rule, away from its border.
    scale = 200
    picture = np.zeros((10 * scale + 1, 10 * scale + 1), np.uint8)
    outline = picture.copy()
    pixels = np.round((np.array(corners) + 5) * scale).astype(np.int32)
    cv2.fillPoly(picture, [pixels], 1)
    cv2.polylines(outline, [pixels], True, 1, 5)
    for id, (x, y) in zip(viewpoints, points):
        column, r = round((x + 5) * scale), round((y + 5) * scale)
        if not outline[r, column]:
            assert (id in chosen) == bool(picture[r, column])


def test_box_keeps_floors_apart_and_takes_the_edges_inside() -> None:
    graph = crossing()
    box = [(-1, -3), (1, -3), (1, 3), (-1, 3)]
    assert select_within(graph, box) == selection(["m", "n1", "s1"], [("m", "n1"), ("m", "s1")])
    assert by_expression(mark_reviewed(graph, ["m"]), "reviewed", kind="viewpoints") == selection(["m"])
