"""Measurements at a viewpoint that a user added, in a world with ground truth."""

from __future__ import annotations

from dataclasses import replace

import pytest
from columns import Columns, fill, flat_floor, room

from nvsim.errors import InputError
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.new_viewpoints import measure_new_viewpoints, with_new_viewpoints
from nvsim.occupancy.types import OCCUPIED

SMALL = MappingConfig(view_size=96)


def graph_of(places: dict[str, tuple[float, float]], *pairs: tuple[str, str]) -> NavGraph:
    viewpoints = {id: Viewpoint(id, (*xy, 1.2), 1.2, origin="person") for id, xy in places.items()}
    edges = {e.key: e for e in (edge(*pair) for pair in pairs)}
    return NavGraph("test", viewpoints, edges)


def test_an_open_way_is_proposed_and_one_through_a_wall_is_doubted() -> None:
    world = Columns(fill(room(6, 4), 3.0, 0.0, 3.1, 4.0, OCCUPIED))
    graph = graph_of({"a": (1.0, 2.0), "b": (2.4, 2.0), "c": (3.9, 2.0)}, ("b", "c"))
    found = measure_new_viewpoints(graph, ["b"], world, flat_floor, world.support, SMALL)
    assert found.proposed == (("a", "b"),) and found.doubted == (("b", "c"),)


def test_the_evidence_tells_the_eight_directions_and_the_corridors_both_ways() -> None:
    world = Columns(room(6, 6))
    graph = graph_of({"a": (2.0, 3.0), "b": (3.5, 3.0)})
    after = with_new_viewpoints(graph, measure_new_viewpoints(graph, ["b"], world, flat_floor, world.support, SMALL))
    assert {k for v, k in after.evidence if v == "b" and k < 8} == set(range(8))
    assert {(e.viewpoint, e.joins) for e in after.evidence.values() if e.joins} == {("a", "b"), ("b", "a")}
    assert after.viewpoints["b"].submap == 0 and after.viewpoints["a"] == graph.viewpoints["a"]


def test_measuring_again_replaces_what_is_out_of_date() -> None:
    world = Columns(room(6, 6))
    graph = graph_of({"a": (2.0, 3.0), "b": (3.5, 3.0)})
    first = with_new_viewpoints(graph, measure_new_viewpoints(graph, ["b"], world, flat_floor, world.support, SMALL))
    moved = replace(
        first, viewpoints={**first.viewpoints, "b": replace(graph.viewpoints["b"], position=(3.0, 3.5, 1.2))}
    )
    second = with_new_viewpoints(moved, measure_new_viewpoints(moved, ["b"], world, flat_floor, world.support, SMALL))
    assert set(second.evidence) == set(first.evidence)
    towards = next(e for e in second.evidence.values() if (e.viewpoint, e.joins) == ("a", "b"))
    assert towards.target == (3.0, 3.5)


def test_what_a_third_viewpoint_joins_by_the_way_is_not_proposed() -> None:
    world = Columns(room(6, 6))
    graph = graph_of({"a": (1.0, 3.0), "b": (3.0, 3.0), "c": (2.0, 3.1)}, ("a", "c"), ("b", "c"))
    found = measure_new_viewpoints(graph, ["b"], world, flat_floor, world.support, SMALL)
    assert found.proposed == ()


def test_an_unknown_viewpoint_is_refused() -> None:
    world = Columns(room(6, 6))
    with pytest.raises(InputError, match="no viewpoint nobody"):
        measure_new_viewpoints(graph_of({"a": (2, 3)}), ["nobody"], world, flat_floor, world.support, SMALL)
