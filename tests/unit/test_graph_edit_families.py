"""The effect of each edit on a graph, and the cases in which it is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.graph import edits
from nvsim.graph.edits import EditError
from nvsim.graph.sight import line_of_sight_test
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap


def graph_of(places: dict[str, tuple[float, float, float]], pairs: str = "") -> NavGraph:
    """Viewpoints at places, and edges such as "ab bc"."""
    made = [edge(*pair) for pair in pairs.split()]
    return NavGraph("scan", {id: Viewpoint(id, p) for id, p in places.items()}, {e.key: e for e in made})


def walk() -> NavGraph:
    """a, b, c, d in a row with a kink, e aside of c."""
    places = {"a": (0, 0, 1.5), "b": (2, 0.5, 1.5), "c": (4, -0.5, 2.0), "d": (6, 0, 1.5), "e": (4, 3, 1.5)}
    return graph_of({k: tuple(map(float, p)) for k, p in places.items()}, "ab bc cd ce")  # type: ignore[misc]


def position(graph: NavGraph, id: str) -> tuple[float, float, float]:
    return graph.viewpoints[id].position


def test_a_placed_viewpoint_is_a_persons_and_its_id_is_made_of_its_place() -> None:
    once = edits.place_viewpoint(walk(), (1.0, 2.0, 1.5), height=1.2)
    again = edits.place_viewpoint(walk(), (1.0, 2.0, 1.5), height=1.2)
    new = next(reversed(once.viewpoints.values()))
    assert list(once.viewpoints) == list(again.viewpoints)
    assert (new.origin, new.height, len(new.id), new.id) == ("person", 1.2, 32, new.id.lower())
    assert len(edits.place_viewpoint(once, (1.0, 2.0, 1.5)).viewpoints) == 7, "a second one there has another id"


def test_snapping_goes_to_the_nearest_frame_of_the_same_floor() -> None:
    frames = [(0.0, 0.0, 1.5), (1.0, 0.0, 1.5), (1.0, 0.0, 4.5)]
    assert edits.nearest_trajectory_position((0.9, 0.1, 4.0), frames) == (2, (1.0, 0.0, 4.5))
    assert edits.nearest_trajectory_position((0.9, 0.1), frames) == (1, (1.0, 0.0, 1.5))
    with pytest.raises(EditError, match="no trajectory"):
        edits.nearest_trajectory_position((0.0, 0.0), [])


def test_split_puts_a_viewpoint_on_the_edge_at_its_share() -> None:
    after = edits.split_edge(walk(), "c", "b", share=0.25, id="m")
    assert position(after, "m") == pytest.approx((3.5, -0.25, 1.875))
    assert ("b", "c") not in after.edges and {("b", "m"), ("c", "m")} <= set(after.edges)
    assert after.edges["b", "m"].origin == after.viewpoints["m"].origin == "person"


def test_merge_takes_over_edges_and_leaves_no_double_or_self_edge() -> None:
    after = edits.merge_viewpoints(walk(), ["b", "c", "d"], into="c")
    assert set(after.edges) == {("a", "c"), ("c", "e")} and position(after, "c") == (4.0, -0.5, 2.0)
    middle = edits.merge_viewpoints(walk(), ["b", "c"], middle=True)
    assert position(middle, "b") == (3.0, 0.0, 1.75) and set(middle.edges) == {("a", "b"), ("b", "d"), ("b", "e")}


def test_straighten_lays_the_inner_viewpoints_on_the_line() -> None:
    after = edits.straighten(walk(), ["d", "c", "b", "a"])
    for id in "bc":
        assert position(after, id)[1:] == pytest.approx((0.0, 1.5))
    assert position(after, "a") == (0.0, 0.0, 1.5) and position(after, "d") == (6.0, 0.0, 1.5)
    even = edits.straighten(walk(), ["a", "b", "c", "d"], even=True)
    assert [position(even, id)[0] for id in "abcd"] == pytest.approx([0, 2, 4, 6])


@pytest.mark.parametrize("ids", [["a", "b"], ["a", "b", "d"], ["b", "c", "d", "e"], ["a", "b", "c", "nobody"]])
def test_straighten_refuses_what_is_no_chain(ids: list[str]) -> None:
    with pytest.raises(EditError):
        edits.straighten(walk(), ids)


@given(st.integers(0, 2**31), st.floats(0, 360), st.floats(0.5, 4))
@settings(max_examples=40, deadline=None)
def test_what_the_builder_placed_by_steps_stays_and_what_was_nudged_returns(
    seed: int, turn: float, step: float
) -> None:
    rng = np.random.default_rng(seed)
    places, pairs = {"v0": np.array([3.0, -2.0])}, []
    for i in range(1, 12):
        parent = str(rng.choice(list(places)))
        heading = math.radians(turn) + math.pi / 4 * rng.integers(8)
        there = places[parent] + step * np.array([math.sin(heading), math.cos(heading)])
        if min(np.linalg.norm(there - p) for p in places.values()) > 0.7 * step:
            places[f"v{i}"] = there
            pairs.append((parent, f"v{i}"))
    viewpoints = {id: Viewpoint(id, (float(x), float(y), 1.5)) for id, (x, y) in places.items()}
    viewpoints["v0"] = replace(viewpoints["v0"], origin="start")
    graph = NavGraph("scan", viewpoints, {e.key: e for e in (edge(*p) for p in pairs)})
    assert edits.align_to_lattice(graph, viewpoints, step, turn, "v0") is graph
    leaf = list(viewpoints)[-1]
    x, y, z = viewpoints[leaf].position
    nudged = edits.move_viewpoint(graph, leaf, (x + 0.15 * step * rng.uniform(-1, 1), y + 0.1 * step, z))
    back = edits.align_to_lattice(nudged, [leaf], step, turn)
    assert position(back, leaf) == pytest.approx((x, y, z), abs=1e-6)


def test_align_without_edges_goes_to_the_square_lattice_about_the_anchor() -> None:
    graph = graph_of({"a": (0, 0, 1), "b": (5.2, 2.4, 1), "c": (-2.2, 0.3, 1)})
    after = edits.align_to_lattice(graph, "bc", spacing=2.5, offset=0, anchor="a")
    assert position(after, "b")[:2] == pytest.approx((5.0, 2.5))
    assert position(after, "c")[:2] == pytest.approx((-2.5, 0.0))


def test_copies_stand_on_the_other_floor_with_their_edges() -> None:
    after = edits.copy_by(walk(), ["a", "b", "e"], 3.0)
    new = list(after.viewpoints.values())[5:]
    assert [v.position for v in new] == [(0, 0, 4.5), (2, 0.5, 4.5), (4, 3, 4.5)]
    assert {v.origin for v in new} == {"person"} and len(after.edges) == 5
    assert new[1].id in after.neighbors(new[0].id) and not after.neighbors(new[2].id)
    with pytest.raises(EditError, match="positions of the originals"):
        edits.copy_by(walk(), ["a"], 0.0)


def test_height_lifts_the_camera_and_leaves_the_floor() -> None:
    after = edits.set_height(walk(), ["c"], 1.2)
    assert after.viewpoints["c"].height == 1.2 and position(after, "c")[2] == pytest.approx(1.7)
    assert edits.set_height(walk(), ["c"], 1.5).viewpoints["c"].origin == "step", "it was so already"


def test_connect_joins_who_sees_whom_and_keeps_floors_apart() -> None:
    places = {
        "a": (0.5, 0.5, 1.5),
        "b": (2.5, 0.5, 1.5),
        "c": (0.5, 2.5, 1.5),
        "up": (0.6, 0.5, 4.5),
        "x": (2.5, 2.5, 1.5),
    }
    graph = edits.set_included(graph_of(places, "ab"), ["x"], False)
    cells = np.full((40, 40), FREE, np.uint8)
    cells[15, :10] = OCCUPIED  # a wall at y 1.5 between a and c
    after = edits.connect_visible(
        graph, graph.viewpoints, 3.0, line_of_sight_test(OccupancyMap(cells, 0.1, (0.0, 0.0)))
    )
    assert set(after.edges) == {("a", "b"), ("b", "c")} and after.edges["b", "c"].origin == "person"
    blind = edits.connect_visible(graph, graph.viewpoints, 3.5)
    assert set(blind.edges) == {("a", "b"), ("b", "c"), ("a", "c")}


def test_connect_agrees_with_looking_at_every_pair() -> None:
    rng = np.random.default_rng(3)
    places = {f"v{i:02d}": tuple(map(float, p)) for i, p in enumerate(rng.uniform(0, 8, (40, 3)))}
    graph = graph_of(places)  # type: ignore[arg-type]
    after = edits.connect_visible(graph, graph.viewpoints, 2.5, steep=30)
    expected = {
        (a, b)
        for a in places
        for b in places
        if a < b
        and math.dist(places[a], places[b]) <= 2.5
        and abs(places[a][2] - places[b][2]) <= math.tan(math.radians(30)) * math.dist(places[a][:2], places[b][:2])
    }
    assert set(after.edges) == expected and expected


LOCKED = edits.set_locked(walk(), ["a"], [("c", "d")])


@pytest.mark.parametrize(
    "edit",
    [
        lambda g: edits.move_viewpoint(g, "a", (1.0, 1.0, 1.0)),
        lambda g: edits.move_viewpoint(g, "d", (1.0, 1.0, 1.0)),
        lambda g: edits.remove_viewpoints(g, ["b", "a"]),
        lambda g: edits.remove_viewpoints(g, ["d"]),
        lambda g: edits.set_included(g, ["a"], False),
        lambda g: edits.set_height(g, ["a"], 1.0),
        lambda g: edits.rename_viewpoint(g, "a", "z"),
        lambda g: edits.remove_edge(g, "d", "c"),
        lambda g: edits.split_edge(g, "c", "d"),
        lambda g: edits.merge_viewpoints(g, ["b", "a"]),
        lambda g: edits.merge_viewpoints(g, ["b", "c"]),
        lambda g: edits.straighten(g, "abcd"),
    ],
)
def test_what_is_locked_refuses_and_unlocked_allows(edit: Callable[[NavGraph], NavGraph]) -> None:
    with pytest.raises(EditError, match=r"locked.*unlock it first\."):
        edit(LOCKED)
    edit(edits.set_locked(LOCKED, ["a"], [("c", "d")], locked=False))


def test_what_is_locked_can_be_reviewed_and_joined() -> None:
    after = edits.add_edge(edits.mark_reviewed(LOCKED, ["a"], [("d", "c")]), "a", "e")
    assert after.viewpoints["a"].reviewed and after.viewpoints["a"].locked and after.edges["c", "d"].reviewed
    assert ("a", "e") in after.edges


def test_moving_takes_the_review_back_and_marks_evidence_stale() -> None:
    cells = np.zeros((2, 2), np.uint8)
    found = [
        Evidence("b", k, 0.0, 2.0, cells, cells, cells > 0, 0, 0.1, 0.9, 0, (4, -0.5), j)
        for k, j in ((0, ""), (8, "c"))
    ]
    graph = edits.mark_reviewed(replace(walk(), evidence={e.key: e for e in found}), "abc", [("b", "c"), ("c", "d")])
    after = edits.move_viewpoint(graph, "c", (4.0, 0.0, 1.5))
    assert [v.reviewed for v in after.viewpoints.values()] == [True, True, False, False, False]
    assert not any(e.reviewed for e in after.edges.values())
    assert [e.stale for e in after.evidence.values()] == [False, True]


def test_rename_keeps_place_in_the_file_edges_and_evidence() -> None:
    cells = np.zeros((2, 2), np.uint8)
    found = [
        Evidence(v, 8, 0.0, 2.0, cells, cells, cells > 0, 0, 0.1, 0.9, 0, (0, 0), j)
        for v, j in (("b", "c"), ("c", "b"))
    ]
    graph = replace(walk(), evidence={e.key: e for e in found})
    after = edits.rename_viewpoint(graph, "c", "0")
    assert list(after.viewpoints) == ["a", "b", "0", "d", "e"] and list(after.edges) == [
        ("a", "b"),
        ("0", "b"),
        ("0", "d"),
        ("0", "e"),
    ]
    assert [(e.viewpoint, e.joins) for e in after.evidence.values()] == [("b", "0"), ("0", "b")]


@pytest.mark.parametrize(
    "edit",
    [
        lambda g: edits.add_viewpoint(g, Viewpoint("a", (0.0, 0.0, 0.0))),
        lambda g: edits.place_viewpoint(g, (0.0, float("inf"), 0.0)),
        lambda g: edits.place_viewpoint(g, (0.0, 0.0, 0.0), id="x/y"),
        lambda g: edits.split_edge(g, "a", "b", share=1.0),
        lambda g: edits.split_edge(g, "a", "d"),
        lambda g: edits.merge_viewpoints(g, ["a"]),
        lambda g: edits.rename_viewpoint(g, "a", "b"),
        lambda g: edits.rename_viewpoint(g, "a", ""),
        lambda g: edits.set_height(g, ["a"], 0.0),
        lambda g: edits.align_to_lattice(g, ["a"], spacing=0.0),
        lambda g: edits.connect_visible(g, ["a", "b"], -1.0),
        lambda g: edits.add_edges(g, [("a", "c"), ("c", "a")]),
        lambda g: edits.remove_edges(g, [("a", "d")]),
        lambda g: edits.ignore_finding(g, "long a b", " "),
        lambda g: edits.heed_finding(g, "long a b"),
        lambda g: edits.mark_reviewed(g, ["z"]),
    ],
)
def test_impossible_edits_say_why_in_one_sentence(edit: Callable[[NavGraph], NavGraph]) -> None:
    before = walk()
    with pytest.raises(EditError) as refusal:
        edit(before)
    assert str(refusal.value).endswith(".") and len(str(refusal.value)) > 15
    assert list(before.viewpoints) == list("abcde") and len(before.edges) == 4


def test_an_edit_that_changes_nothing_returns_the_very_graph() -> None:
    graph = walk()
    for same in (
        edits.move_viewpoint(graph, "a", (0.0, 0.0, 1.5)),
        edits.remove_viewpoints(graph, []),
        edits.set_included(graph, ["a"], True),
        edits.mark_reviewed(graph, ["a"], reviewed=False),
        edits.rename_viewpoint(graph, "a", "a"),
        edits.align_to_lattice(graph, []),
        edits.connect_visible(graph, ["a"], 9.0),
    ):
        assert same is graph
