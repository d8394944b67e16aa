"""The builder in worlds of columns, where every true answer is known from the map."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.events import Event, Progress, Warning
from nvsim.graph.connectivity import check_scan_id
from nvsim.graph.paths import components
from nvsim.graph.store import same_graph
from nvsim.graph.types import NavGraph
from nvsim.graph.types import edge as between
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.paths import segment_is_free
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

SMALL = MappingConfig(view_size=96)
LATTICE = replace(SMALL, settle=False, jitter=0.0)


def walk(*corners: tuple[float, float], height: float = 1.2) -> NDArray[np.float64]:
    """A camera every 0.3 m along the corners."""
    parts = []
    for a, b in zip(np.array(corners[:-1]), np.array(corners[1:])):
        count = max(2, int(np.hypot(*(b - a)) / 0.3))
        parts.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
    xy = np.concatenate(parts)
    return np.column_stack([xy, np.full(len(xy), height)])


def build(
    occupancy: OccupancyMap, positions: NDArray[np.float64], config: MappingConfig = SMALL, noise: float = 0.0
) -> BuildResult:
    world = Columns(occupancy, noise)
    return build_map(world, positions, flat_floor, world.support, config, scan="test")


def place(graph: NavGraph, id: str) -> NDArray[np.float64]:
    return np.array(graph.viewpoints[id].position[:2])


def assert_valid(graph: NavGraph, occupancy: OccupancyMap) -> None:
    assert all(occupancy.states_at(place(graph, id)) == FREE for id in graph.viewpoints)
    assert all(segment_is_free(occupancy, place(graph, a), place(graph, b)) for a, b in graph.edges)


def test_room_is_filled_with_valid_steps_of_exactly_the_step_length() -> None:
    occupancy = room(8, 8)
    graph = build(occupancy, walk((2, 4), (6, 4)), LATTICE).graph
    assert len(graph.viewpoints) >= 8
    assert_valid(graph, occupancy)
    turns = set()
    for (a, b), edge in graph.edges.items():
        d = place(graph, b) - place(graph, a)
        if edge.origin == "step":
            assert abs(np.hypot(*d) - SMALL.tau_dist) < 1e-9
            turns.add(round((np.degrees(np.arctan2(d[0], d[1])) - 7.5) / 45) % 8)
    assert {k % 2 for k in turns} == {0, 1}, "axis steps and diagonals"


def test_no_step_leads_between_two_views_of_30_degrees() -> None:
    graph = build(room(8, 8), walk((2, 4), (6, 4)), LATTICE).graph
    for (a, b), edge in graph.edges.items():
        if edge.origin == "step":
            d = place(graph, b) - place(graph, a)
            heading = np.degrees(np.arctan2(d[0], d[1])) % 360
            off_center = abs((heading + 15) % 30 - 15)
            assert off_center == pytest.approx(7.5, abs=1e-6)


def test_search_does_not_leave_through_a_hole_in_the_outer_wall() -> None:
    occupancy = fill(room(6, 6), 5.9, 1.5, 6.3, 4.5, FREE)
    result = build(occupancy, walk((2, 3), (4, 3)))
    assert all(0 < place(result.graph, id)[0] < 6.1 for id in result.graph.viewpoints)
    assert result.report["decisions"]["unknown"] > 0
    # Where somebody did see the floor outside, the same hole is a door.
    outside = fill(occupancy, 6.1, 0, 9.5, 6, FREE)
    assert any(place(g, id)[0] > 6.3 for g in [build(outside, walk((2, 3), (4, 3))).graph] for id in g.viewpoints)


def test_chair_at_the_end_of_a_step_blocks_the_worst_row_but_not_the_mean() -> None:
    start, heading = np.array([3.0, 1.0]), np.radians(7.5)
    end = start + 2.55 * np.array([np.sin(heading), np.cos(heading)])
    occupancy = fill(room(6, 6), *(end - 0.12), *(end + 0.12), OCCUPIED)
    positions = np.array([[*start, 1.2]])

    def decision(config: MappingConfig) -> str:
        world = Columns(occupancy)
        graph = build_map(world, positions, flat_floor, world.support, config, scan="test").graph
        first = next(iter(graph.viewpoints))
        return graph.evidence[first, 0].decision

    assert decision(replace(SMALL, support=0.5)) == "alpha"
    assert decision(replace(MappingConfig.paper(), view_size=96)) == "open"


@pytest.mark.parametrize("offset", [0.0, 0.37, 0.81])
def test_merging_invents_no_edge_through_a_thin_wall(offset: float) -> None:
    occupancy = fill(room(7, 7), 3.45, 0, 3.55, 7, OCCUPIED)
    positions = np.concatenate([walk((1.5, 1.2 + offset), (1.5, 5.8)), walk((5.5, 5.8), (5.5, 1.2 + offset))])
    graph = build(occupancy, positions).graph
    assert_valid(graph, occupancy)
    left = {id for id in graph.viewpoints if place(graph, id)[0] < 3.5}
    assert left and left != set(graph.viewpoints), "both sides are explored"
    assert all((a in left) == (b in left) for a, b in graph.edges)


def test_rooms_behind_narrow_doors_join_in_one_component() -> None:
    occupancy = fill(fill(room(12, 6), 5.9, 0, 6.1, 6, OCCUPIED), 5.8, 2.5, 6.2, 3.4, FREE)
    result = build(occupancy, walk((2, 1), (2, 5), (5, 2.95), (7, 2.95), (10, 1), (10, 5)))
    assert_valid(result.graph, occupancy)
    assert result.report["components"] == 1
    assert {place(result.graph, id)[0] > 6 for id in result.graph.viewpoints} == {True, False}


@pytest.mark.parametrize(
    ("between", "reach", "why"),
    [
        (OCCUPIED, 3.5, "an obstacle is in the corridor; photograph"),
        (UNKNOWN, 3.5, r"no image and no LiDAR scan shows floor along the corridor around x (5\.9|6\.0|6\.1), y"),
        (OCCUPIED, 0.5, "too far for an edge: photograph the area between them"),
    ],
)
def test_what_stays_separate_is_reported_with_what_keeps_it_apart(between: int, reach: float, why: str) -> None:
    occupancy = fill(room(12, 6), 5.9, 0, 6.1, 6, between)
    events: list[Event] = []
    world = Columns(occupancy)
    positions = np.concatenate([walk((2, 1), (2, 5)), walk((10, 1), (10, 5))])
    config = replace(SMALL, reach=reach)
    result = build_map(world, positions, flat_floor, world.support, config, scan="test", listen=events.append)
    assert result.report["components"] == 2
    said = [e.text for e in events if isinstance(e, Warning) and "2 disconnected parts" in e.text]
    assert len(said) == 1 and re.search(why, said[0]) and said[0].count("nearest to another part at x") == 1


@pytest.mark.parametrize("seed", [0, 11])
def test_rooms_behind_gaps_that_are_too_narrow_stay_separate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    occupancy = room(12, 8)
    for x in (3, 6, 9):
        wall = UNKNOWN if rng.random() < 0.3 else OCCUPIED
        occupancy = fill(occupancy, x - 0.05, 0, x + 0.05, 8, wall)
        y = rng.uniform(1, 6.5)
        occupancy = fill(occupancy, x - 0.1, y, x + 0.1, y + rng.choice([0.35, 0.45, 0.55]), FREE)
    result = build(occupancy, np.concatenate([walk((x, 1), (x, 7)) for x in (1.5, 4.5, 7.5, 10.5)]))
    assert_valid(result.graph, occupancy)
    assert result.report["components"] >= 3


def test_search_stops_at_the_cap_and_far_from_the_walk_and_says_so() -> None:
    occupancy = room(14, 6)
    capped = build(occupancy, walk((1, 3), (3, 3)), replace(SMALL, max_viewpoints=4))
    assert len(capped.graph.viewpoints) <= 4
    assert capped.report["limited"] and capped.report["decisions"]["limit"] > 0
    near = build(occupancy, walk((1, 3), (3, 3)), replace(SMALL, max_distance=3.0))
    assert max(place(near.graph, id)[0] for id in near.graph.viewpoints) < 6.0
    assert near.report["decisions"]["distance"] > 0


def test_height_comes_from_the_nearest_camera() -> None:
    positions = walk((2, 4), (6, 4))
    positions[:, 2] = 1.0 + 0.05 * positions[:, 0]
    graph = build(room(8, 8), positions).graph
    for v in graph.viewpoints.values():
        nearest = positions[np.argmin(np.hypot(*(positions[:, :2] - v.position[:2]).T))]
        assert v.position[2] == nearest[2] and v.height == pytest.approx(nearest[2])


def test_two_builds_are_the_same_to_the_last_bit() -> None:
    occupancy = fill(room(8, 8), 3, 3, 4, 4.5, OCCUPIED)
    a, b = (build(occupancy, walk((1.5, 1.5), (6, 1.5), (6, 6)), noise=0.03).graph for _ in range(2))
    assert same_graph(a, b)
    for id in a.viewpoints:
        assert len(id) == 32 and int(id, 16) >= 0
        check_scan_id(a.scan)


def rebuild(result: BuildResult, world: Columns, positions: NDArray[np.float64], config: MappingConfig) -> BuildResult:
    """Decides again what `result` measured."""
    known = {"previous": result.graph, "remembered": result.measured}
    return build_map(world, positions, flat_floor, world.support, config, scan="test", **known)


def test_reapplying_equals_a_fresh_build_and_renders_only_the_new_frontier() -> None:
    occupancy = fill(fill(room(9, 8), 3, 2.5, 4.2, 4.5, OCCUPIED), 6.5, 0, 6.6, 4.6, OCCUPIED)
    positions = walk((1.5, 1.5), (5, 1.5), (5, 6), (2, 6))
    world = Columns(occupancy, noise=0.05)
    # A limit between: the strict build accepts only what is far from everything.
    strict = replace(SMALL, robot_radius=0.35, row_alpha=0.15)
    builds = {
        config: build_map(world, positions, flat_floor, world.support, config, scan="test")
        for config in (strict, SMALL)
    }
    assert len(builds[SMALL].graph.viewpoints) > len(builds[strict].graph.viewpoints)
    for before, after in ((strict, SMALL), (SMALL, strict)):
        fresh = builds[after]
        world.rendered = 0
        again = rebuild(builds[before], world, positions, after)
        assert same_graph(again.graph, fresh.graph)
        assert world.rendered == again.report["rendered_views"]
        assert world.rendered < 0.9 * fresh.report["rendered_views"]
    world.rendered = 0
    same = rebuild(builds[SMALL], world, positions, SMALL)
    assert same_graph(same.graph, builds[SMALL].graph)
    assert world.rendered <= 0.15 * builds[SMALL].report["rendered_views"], "only places that were refused before"


def test_reapplying_keeps_what_a_person_added() -> None:
    world = Columns(room(8, 8))
    positions = walk((2, 4), (6, 4))
    graph = build_map(world, positions, flat_floor, world.support, SMALL, scan="test").graph
    from nvsim.graph.edits import add_edge, add_viewpoint
    from nvsim.graph.types import Viewpoint

    first = next(iter(graph.viewpoints))
    edited = add_edge(add_viewpoint(graph, Viewpoint("mine", (7.0, 7.0, 1.2), origin="person")), first, "mine")
    again = build_map(world, positions, flat_floor, world.support, SMALL, scan="test", previous=edited).graph
    assert "mine" in again.viewpoints and again.neighbors("mine") == (first,)


def test_walk_that_stands_on_nothing_is_refused_with_a_sentence() -> None:
    with pytest.raises(InputError, match="No position has room"):
        build(fill(room(4, 4), 0, 0, 4, 4, UNKNOWN), walk((1, 2), (3, 2)))
    with pytest.raises(InputError, match="trajectory is empty"):
        build(room(4, 4), np.zeros((0, 3)))


def test_floor_beside_a_trajectory_that_stands_on_nothing_known_is_searched() -> None:
    occupancy = fill(room(8, 6), 0, 0, 8, 1.6, UNKNOWN)
    graph = build(occupancy, walk((3, 1), (5, 1))).graph
    assert len(graph.viewpoints) >= 3 and len(graph.edges) >= 2
    assert all(place(graph, id)[1] > 1.6 for id in graph.viewpoints)
    assert_valid(graph, occupancy)


def test_a_build_from_kept_evidence_ends_the_same_and_renders_only_the_rest(monkeypatch) -> None:
    monkeypatch.setattr("nvsim.mapping.builder._KEEPING", 0.0)
    occupancy = fill(room(9, 8), 3, 2.5, 4.2, 4.5, OCCUPIED)
    positions = walk((1.5, 1.5), (5, 1.5), (5, 6), (2, 6))
    kept: list = []
    world = Columns(occupancy, noise=0.05)
    whole = build_map(world, positions, flat_floor, world.support, SMALL, scan="test", keep=kept.append)
    assert len(kept) > 3
    half = kept[len(kept) // 2]
    resumed = build_map(world, positions, flat_floor, world.support, SMALL, scan="test", previous=half)
    assert same_graph(resumed.graph, whole.graph)
    assert 0 < resumed.report["rendered_viewpoints"] < whole.report["rendered_viewpoints"]


def test_progress_never_goes_back_and_is_full_only_at_the_end() -> None:
    """Two rooms with no door between, so that there are several searches, and a place where nobody can stand."""
    occupancy = fill(room(14, 6), 6.8, 0, 7.2, 6, OCCUPIED)
    occupancy = fill(occupancy, 12.2, 2.6, 13.2, 3.4, OCCUPIED)
    world, heard = Columns(occupancy), list[Event]()
    positions = np.concatenate([walk((1, 3), (6, 3)), walk((8, 3), (13, 3))])
    result = build_map(world, positions, flat_floor, world.support, SMALL, scan="test", listen=heard.append)
    steps = [e for e in heard if isinstance(e, Progress)]
    assert len({e.total for e in steps}) == 1 and len(steps) > 10
    done = [e.done for e in steps]
    assert done == sorted(done) and done[0] < done[-1] == steps[-1].total and done.count(done[-1]) == 1
    assert steps[-1].detail == f"{len(result.graph.viewpoints)} viewpoints" and result.report["starts"] >= 2
    assert any("of the trajectory left" in e.detail for e in steps)
    assert any("settling" in e.detail for e in steps)


def test_where_somebody_turned_about_without_a_scan_viewpoints_stand_closer_and_on_the_floor_around() -> None:
    occupancy = room(4, 3)
    turned = walk((1.6, 1.5), (2.4, 1.5))
    world = Columns(occupancy)

    def found(scanned: bool) -> NDArray[np.float64]:
        graph = build_map(world, turned, flat_floor, world.support, SMALL, scan="t", scanned=scanned).graph
        assert_valid(graph, occupancy)
        return np.array([place(graph, id) for id in graph.viewpoints])

    usual, closer = found(True), found(False)
    assert len(closer) > len(usual)
    apart = np.linalg.norm(closer[:, None] - closer, axis=2) + 10 * np.eye(len(closer))
    assert apart.min() < SMALL.merge_radius
    assert np.abs(closer[:, 1] - 1.5).max() > 0.5


def test_without_a_scan_a_small_room_is_covered_more_closely() -> None:
    occupancy = room(5, 4)
    turn = np.linspace(0, 2 * np.pi, 40)
    around = np.column_stack([2.5 + 1.9 * np.cos(turn), 2 + 1.4 * np.sin(turn), np.full(40, 1.4)])
    world = Columns(occupancy)

    def farthest(scanned: bool) -> tuple[NavGraph, float]:
        graph = build_map(world, around, flat_floor, world.support, SMALL, scan="t", scanned=scanned).graph
        there = np.array([place(graph, id) for id in graph.viewpoints])
        return graph, float(np.linalg.norm(around[:, None, :2] - there, axis=2).min(axis=1).max())

    (usual, far), (closely, near) = farthest(True), farthest(False)
    assert near < far and len(closely.viewpoints) > len(usual.viewpoints)
    assert_valid(closely, occupancy)


def test_parts_that_a_user_joined_are_one_and_what_a_user_added_is_no_part_to_explain() -> None:
    occupancy = fill(room(12, 6), 5.9, 0, 6.1, 6, OCCUPIED)
    world = Columns(occupancy)
    positions = np.concatenate([walk((2, 1), (2, 5)), walk((10, 1), (10, 5))])
    first = build_map(world, positions, flat_floor, world.support, SMALL, scan="test")
    a, b = (min(group) for group in components(first.graph))
    here = first.graph.viewpoints[a]
    alone = replace(here, id="f" * 32, position=(6.0, 3.0, 1.2), origin="person")
    added = replace(first.graph, viewpoints={**first.graph.viewpoints, alone.id: alone})
    joined = replace(
        first.graph, edges={**first.graph.edges, between(a, b).key: replace(between(a, b), origin="person")}
    )
    for previous, parts in ((added, 3), (joined, 1)):
        events: list[Event] = []
        known = {"previous": previous, "remembered": first.measured}
        again = build_map(
            world, positions, flat_floor, world.support, SMALL, scan="test", listen=events.append, **known
        )
        assert again.report["components"] == parts
        said = " ".join(e.text for e in events if isinstance(e, Warning))
        assert ("disconnected parts" in said) == (parts > 1)
        assert said.count("nearest to another") == (parts > 1)
