"""Storeys from the heights of viewpoints."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nvsim.geometry.storeys import storeys
from nvsim.graph.expression import by_expression
from nvsim.graph.types import NavGraph, Viewpoint, edge


def test_a_house_of_three_floors_with_stairs_has_three_storeys() -> None:
    rng = np.random.default_rng(1)
    floors = [3.02 * k + rng.normal(0, 0.05, 30) for k in range(3)]
    stairs = [0.6, 1.2, 1.8, 2.4, 3.6, 4.2, 4.9, 5.5]
    found = storeys(np.concatenate([*floors, stairs]))
    assert [round(s.floor, 1) for s in found] == [0.0, 3.0, 6.0]
    assert sum(s.count for s in found) == 98
    first, second, _ = found
    assert first.contains_floors(np.array([-5.0, 0.0, 1.2, 2.4, 3.0])).tolist() == [True, True, True, True, False]
    assert second.contains_floors(np.array([0.0, 0.6, 2.4, 3.0, 5.4, 6.0])).tolist() == [
        False,
        True,
        True,
        True,
        True,
        False,
    ]


def test_a_ramp_and_a_few_outliers_are_one_storey() -> None:
    floors = np.concatenate([np.linspace(0, 1.1, 60), [6.5, -7.2]])
    assert len(storeys(floors)) == 1


def test_a_few_viewpoints_on_a_roof_are_a_storey_of_their_own() -> None:
    assert [s.count for s in storeys(np.array([0.0] * 20 + [4.0] * 4))] == [20, 4]


def test_expressions_know_the_storey() -> None:
    viewpoints = {f"v{i}": Viewpoint(f"v{i}", (float(i), 0.0, 1.5 + (3.0 if i > 3 else 0.0))) for i in range(8)}
    graph = NavGraph("house", viewpoints, {(f"v{a}", f"v{a + 1}"): edge(f"v{a}", f"v{a + 1}") for a in range(7)})
    chosen = by_expression(graph, "storey == 2")
    assert chosen.viewpoints == {"v4", "v5", "v6", "v7"} and ("v4", "v5") in chosen.edges
    assert not by_expression(graph, "storey > 2")


@given(st.lists(st.floats(-50, 50), max_size=60))
def test_everything_stands_on_some_storey_and_no_floor_on_two(floors: list[float]) -> None:
    heights = np.array(floors)
    found = storeys(heights)
    assert bool(found) == bool(floors) and sum(s.count for s in found) == len(floors)
    if found:
        held = np.array([s.contains_floors(heights) for s in found])
        assert held.any(axis=0).all()
        for i, storey in enumerate(found):
            assert [s.contains_floors(np.array([storey.floor]))[0] for s in found] == [
                j == i for j in range(len(found))
            ]
