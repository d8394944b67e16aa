"""Findings: each kind at its place, and a validator that after each edit equals a new check."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.graph import edits, operations
from nvsim.graph.edits import EditError
from nvsim.graph.findings import Context, Finding, Limits, Validator, check_graph
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.types import OccupancyMap


def graph_of(
    places: dict[str, tuple[float, float, float]], pairs: list[tuple[str, str]], scan: str = "scan"
) -> NavGraph:
    edges = [edge(a, b) for a, b in pairs]
    return NavGraph(scan, {id: Viewpoint(id, p) for id, p in places.items()}, {e.key: e for e in edges})


LINE = graph_of({"a": (0, 0, 1.5), "b": (2, 0, 1.5), "c": (4, 0, 1.5)}, [("a", "b"), ("b", "c")])


def keys(graph: NavGraph, context: Context | None = None) -> set[str]:
    return {f.key for f in check_graph(graph, context or Context())}


def test_a_sound_graph_has_no_finding() -> None:
    assert keys(LINE) == set()


@pytest.mark.parametrize(
    ("graph", "expected"),
    [
        (edits.remove_edge(LINE, "b", "c"), {"isolated/c"}),
        (replace(LINE, scan="two_words"), {"scan"}),
        (NavGraph("scan"), {"empty"}),
        (graph_of({"a/b": (0, 0, 1), "c": (2, 0, 1)}, [("a/b", "c")]), {"id/a/b"}),
        (graph_of({"a": (0, 0, 1), "b": (0.1, 0, 1)}, [("a", "b")]), {"duplicate/a/b"}),
        (graph_of({"a": (0, 0, 1), "b": (6, 0, 1)}, [("a", "b")]), {"long/a/b"}),
        (graph_of({"a": (0, 0, 1), "b": (1, 0, 2.2)}, [("a", "b")]), {"steep/a/b"}),
        (
            graph_of({n: (i * 2.0, 0, 1) for i, n in enumerate("abcde")}, [("a", "b"), ("b", "c"), ("d", "e")]),
            {"island/d"},
        ),
    ],
)
def test_each_trouble_is_named_once(graph: NavGraph, expected: set[str]) -> None:
    assert keys(graph) == expected


def test_what_the_map_the_floor_the_pictures_and_the_evidence_say() -> None:
    cells = np.zeros((20, 60), np.uint8)
    cells[:, 28:32] = 1  # a wall at x = 1.8 to 2.2, where b stands
    occupancy = OccupancyMap(cells, 0.1, (-1.0, -1.0))
    assert keys(LINE, Context(occupancy=occupancy)) == {"obstacle/b", "occupied/a/b", "occupied/b/c"}
    assert keys(LINE, Context(floor=lambda x, y, z: 1.0 if x < 1 else math.nan)) == {"floor/a"}
    assert keys(LINE, Context(images=frozenset("ab"))) == {"panorama/c"}
    pictured = Context(images=frozenset("abc"), taken={"a": (0.0, 0.0, 1.5), "b": LINE.viewpoints["b"].position})
    assert keys(edits.move_viewpoint(LINE, "b", (2.0, 0.4, 1.5)), pictured) >= {"moved/b"}
    assert keys(LINE, pictured) <= {"moved/a"}
    context = Context(against=lambda graph, key: "mean alpha 0.97" if key == ("a", "b") else "")
    assert keys(LINE, context) == {"evidence/a/b"}
    assert keys(edits.mark_reviewed(LINE, edges=[("a", "b")]), context) == set()


def test_excluded_viewpoints_and_their_edges_are_let_be() -> None:
    far = edits.set_included(edits.move_viewpoint(LINE, "c", (40, 0, 1.5)), ["c"], False)
    assert keys(far) == set()


# b and d stand 1 m apart, and the way between them leads past c.
AROUND = graph_of(
    {"a": (-2, 0, 1.5), "b": (0, 0, 1.5), "c": (2, 0.5, 1.5), "d": (0, 1, 1.5)}, [("a", "b"), ("b", "c"), ("c", "d")]
)


def test_near_viewpoints_that_a_long_way_joins_are_named() -> None:
    assert keys(AROUND) == {"detour/b/d"}
    assert keys(edits.move_viewpoint(AROUND, "c", (1.0, 0.5, 1.5))) == set(), "the way is short now"
    assert keys(edits.move_viewpoint(AROUND, "d", (0.5, 1.5, 1.5))) == set(), "they are not near"
    upstairs = replace(AROUND, viewpoints={**AROUND.viewpoints, "d": replace(AROUND.viewpoints["d"], height=0.7)})
    assert keys(upstairs) == set(), "d stands on a table"
    assert keys(AROUND, Context(Limits(detour=5.0))) == set()
    apart = edits.remove_edge(AROUND, "b", "c")
    assert keys(apart) == {"detour/b/d", "island/c"}, "no way at all is a long one"


def test_what_is_known_to_be_closed_between_near_viewpoints_silences_it() -> None:
    cells = np.zeros((40, 60), np.uint8)
    cells[15, 8:12] = 1  # at y = 0.5
    assert keys(AROUND, Context(occupancy=OccupancyMap(cells, 0.1, (-1.0, -1.0)))) == set()
    assert keys(AROUND, Context(closed=lambda graph, key: key == ("b", "d"))) == set()
    assert keys(AROUND, Context(closed=lambda graph, key: key == ("b", "c"))) == {"detour/b/d"}
    assert keys(AROUND, Context(visible=lambda a, b: np.zeros(len(a), bool))) == set()


def apply(graph: NavGraph, fix_of: Finding) -> NavGraph:
    fix = fix_of.fixes[0]
    return operations.apply(graph, fix.operation, fix.arguments)


@pytest.mark.parametrize("kind", ["long", "steep", "duplicate", "detour", "island", "isolated"])
def test_the_first_fix_mends_the_finding(kind: str) -> None:
    graph = {
        "duplicate": graph_of({"a": (0, 0, 1), "b": (0.1, 0, 1), "c": (2, 0, 1)}, [("a", "c"), ("b", "c")]),
        "detour": AROUND,
        "long": graph_of({"a": (0, 0, 1), "b": (6, 0, 1)}, [("a", "b")]),
        "steep": graph_of({"a": (0, 0, 1), "b": (1, 0, 2.2), "c": (2, 0, 1)}, [("a", "b"), ("b", "c"), ("a", "c")]),
        "island": graph_of({n: (i * 2.0, 0, 1) for i, n in enumerate("abcd")}, [("a", "b"), ("c", "d")]),
        "isolated": edits.remove_edge(LINE, "b", "c"),
    }[kind]
    finding = next(f for f in check_graph(graph) if f.kind == kind)
    assert finding.key not in keys(apply(graph, finding))


def test_every_fix_can_be_done_by_name() -> None:
    cells = np.zeros((20, 60), np.uint8)
    cells[:, 28:32] = 1
    places = {"a b": (0, 0, 1), "b": (2, 0, 1), "c": (2.1, 0, 1), "d": (9, 0, 4), "e": (11, 0, 1), "f": (30, 0, 1)}
    graph = graph_of(places, [("a b", "b"), ("b", "c"), ("d", "e")])
    context = Context(
        occupancy=OccupancyMap(cells, 0.1, (-1.0, -1.0)),
        floor=lambda x, y, z: 0.0,
        images=frozenset("ab"),
        taken={"b": (2.0, 1.0, 1.0)},
        against=lambda graph, key: "something stands there",
        possible_glass=lambda a, b: "skips 12 m of the trajectory",
        one_way=frozenset({("b", "c")}),
        entries={"b": (("self", "names itself"),)},
    )
    found = check_graph(graph, context)
    assert {f.kind for f in found} >= {"id", "isolated", "island", "duplicate", "obstacle", "floor", "panorama",
                                      "moved", "occupied", "evidence", "glass", "steep", "one_way", "self"}  # fmt: skip
    for finding in found:
        for fix in finding.fixes:
            after = operations.apply(graph, fix.operation, fix.arguments)
            assert finding not in check_graph(after, context), (finding, fix)


NAMES = [f"v{i}" for i in range(14)]
PLACES = st.tuples(*(st.integers(0, 12).map(lambda v: v * 0.2 if v < 4 else v * 0.6) for _ in "xy"), st.just(1.5))
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("add_viewpoint"), st.sampled_from(NAMES), PLACES),
        st.tuples(st.just("move_viewpoint"), st.sampled_from(NAMES), PLACES),
        st.tuples(st.just("remove_viewpoints"), st.lists(st.sampled_from(NAMES), min_size=1, max_size=3)),
        st.tuples(st.just("set_included"), st.lists(st.sampled_from(NAMES), max_size=3), st.booleans()),
        st.tuples(st.just("add_edge"), st.sampled_from(NAMES), st.sampled_from(NAMES)),
        st.tuples(st.just("remove_edge"), st.sampled_from(NAMES), st.sampled_from(NAMES)),
    ),
    max_size=60,
)


@settings(max_examples=150, deadline=None)
@given(STEPS)
def test_following_edits_finds_what_a_fresh_look_finds(steps: list[tuple]) -> None:
    cells = np.zeros((80, 80), np.uint8)
    cells[30:33, 10:50] = 1
    context = Context(
        Limits(long=3.0),
        OccupancyMap(cells, 0.1, (-0.5, -0.5)),
        closed=lambda graph, key: key[0] == "v3",
        images=frozenset(NAMES[:9]),
    )
    graph = NavGraph("scan")
    validator, history = Validator(graph, context), [graph]
    for name, *arguments in [*steps, ("undo",), ("undo",), ("undo",)]:
        try:
            if name == "undo":
                graph = history.pop() if len(history) > 1 else graph
            elif name == "add_viewpoint":
                graph = edits.add_viewpoint(graph, Viewpoint(*arguments))
            else:
                graph = getattr(edits, name)(graph, *arguments)
        except EditError:
            continue
        known = set(validator.findings)
        came, went = validator.update(graph)
        fresh = {f.key: f for f in check_graph(graph, context)}
        assert dict(validator.findings) == fresh
        assert went == known - set(fresh) and came >= set(fresh) - known
        history.append(graph)


def test_evidence_measured_anew_is_looked_at_again() -> None:
    context = Context(against=lambda graph, key: "it is closed" if graph.evidence else "")
    validator = Validator(LINE, context)
    shape = (2, 2)
    cells = np.zeros(shape, np.uint8)
    found = Evidence("a", 2, 0.0, 2.0, cells, cells, np.ones(shape, bool), 0.0, 1.0, 0.6, 0, (2.0, 0.0), "b")
    came, went = validator.update(replace(LINE, evidence={found.key: found}))
    assert (came, went) == ({"evidence/a/b"}, set())


def test_a_corridor_measured_anew_silences_a_detour() -> None:
    validator = Validator(AROUND, Context(closed=lambda graph, key: bool(graph.evidence)))
    cells = np.zeros((2, 2), np.uint8)
    found = Evidence("b", 2, 0.0, 2.0, cells, cells, cells == 0, 0.0, 1.0, 0.6, 0, (0.0, 2.0))
    assert validator.update(replace(AROUND, evidence={found.key: found})) == (set(), {"detour/b/d"})
    assert validator.update(AROUND) == ({"detour/b/d"}, set())


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_detours_are_followed_through_a_dense_graph(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"v{i}" for i in range(40)]
    places = {n: (*rng.uniform(0, 6, 2).tolist(), 1.5) for n in names}
    near = [(a, b) for a in names for b in names if a < b and math.dist(places[a], places[b]) < 2]
    graph = graph_of(places, [pair for pair in near if rng.random() < 0.3])
    validator, seen = Validator(graph), 0
    for _ in range(12):
        name = names[rng.integers(40)]
        match rng.integers(4):
            case 0:
                graph = edits.move_viewpoint(graph, name, (*rng.uniform(0, 6, 2).tolist(), 1.5))
            case 1:
                graph = edits.set_included(graph, [name], not graph.viewpoints[name].included)
            case 2 if graph.edges:
                graph = edits.remove_edge(graph, *list(graph.edges)[rng.integers(len(graph.edges))])
            case _:
                free = [pair for pair in near if pair not in graph.edges]
                graph = edits.add_edge(graph, *free[rng.integers(len(free))])
        validator.update(graph)
        fresh = {f.key: f for f in check_graph(graph)}
        assert dict(validator.findings) == fresh
        seen += sum(f.kind == "detour" for f in fresh.values())
    assert seen


def test_a_sight_line_meets_what_fine_samples_meet() -> None:
    rng = np.random.default_rng(3)
    cells = (rng.random((70, 90)) < 0.02).astype(np.uint8)
    occupancy = OccupancyMap(cells, 0.1, (-1.0, -2.0))
    context, crossed = Context(occupancy=occupancy), 0
    for a, b in rng.uniform((-1.5, -2.5), (8.5, 5.5), (400, 2, 2)):
        samples = a + np.linspace(0, 1, 4000)[:, None] * (b - a)
        expected = bool((occupancy.states_at(samples) == 1).any())
        crossed += expected
        # A step of a quarter cell may pass over a corner; nothing more.
        shares = (occupancy.states_at(samples) == 1).mean() * np.linalg.norm(b - a) / 0.1
        assert context.crosses_obstacle(tuple(a), tuple(b)) == expected or shares < 0.3
    assert 100 < crossed < 390


@pytest.mark.parametrize(
    ("ids", "shown"),
    [
        (["house_01_0000", "house_01_0001", "house_01_0002"], ["house_01_0000", "house_01_0001", "house_01_0002"]),
        (["house_01_0000_left", "house_01_0001_left"], ["house_01_0000", "house_01_0001"]),
        ([f"{i:032d}" for i in (1, 12, 103)], [f"{i:032d}"[:31] for i in (1, 12, 103)]),
        (["0123456789abcdef", "123456789abcdef0"], ["01234567", "12345678"]),
        (["short", "shorter_than_all"], ["short", "shorter_"]),
        (["abc", "abcdefghijklmnop"], ["abc", "abcdefgh"]),
        (["a" * 20, "a" * 19 + "b", "c" * 20], ["a" * 20, "a" * 19 + "b", "c" * 20]),
    ],
)
def test_ids_are_shortened_as_far_as_they_differ(ids: list[str], shown: list[str]) -> None:
    graph = NavGraph("s", {id: Viewpoint(id, (float(i), 0.0, 1.5)) for i, id in enumerate(ids)}, {})
    assert [graph.short(id) for id in ids] == shown
    assert len({graph.short(id, 6) for id in ids}) == len(ids)
    assert graph.short("never_seen_before") == "never_seen_before"[: len(graph.short("never_seen_before"))]


def test_messages_tell_viewpoints_apart_whose_ids_begin_alike() -> None:
    ids = [f"house_01_{i:04d}" for i in range(4)]
    places = [(0.0, 0.0, 1.5), (2.0, 0.0, 1.5), (2.05, 0.0, 1.5), (40.0, 0.0, 1.5)]
    viewpoints = {id: Viewpoint(id, place) for id, place in zip(ids, places)}
    graph = NavGraph("s", viewpoints, {e.key: e for e in (edge(ids[0], ids[1]), edge(ids[0], ids[2]))})
    context = Context(one_way=frozenset({(ids[0], ids[1])}))
    messages = [finding.message for finding in check_graph(graph, context)]
    assert "The edge between house_01_0000 and house_01_0001 goes one way only in the file" in " ".join(messages)
    assert any("house_01_0001 and house_01_0002 are 0.05 m apart" in message for message in messages)
    assert any("Viewpoint house_01_0003 has no edge" in message for message in messages)
    assert not any(re.search(r"house_01\b(?!_)", message) for message in messages)
