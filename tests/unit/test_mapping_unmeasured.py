"""Whether corridors in other directions contradict an edge that was not measured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room

from nvsim.graph import edits
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.explanation.explain import closed_path_test
from nvsim.occupancy.types import OCCUPIED, UNKNOWN, OccupancyMap

CONFIG = MappingConfig(view_size=128, settle=False, jitter=0.0)


def built(occupancy: OccupancyMap) -> NavGraph:
    world = Columns(occupancy)
    return build_map(world, np.array([[3.0, 2.0, 1.2]]), flat_floor, world.support, CONFIG, scan="test").graph


def with_neighbor(graph: NavGraph, angle: float, distance: float = 1.2) -> NavGraph:
    start = next(v for v in graph.viewpoints.values() if v.origin == "start")
    x, y, z = start.position
    place = (x + distance * math.sin(angle), y + distance * math.cos(angle), z)
    return edits.add_viewpoint(graph, Viewpoint("beside", place, start.height))


def start_of(graph: NavGraph) -> str:
    return next(v.id for v in graph.viewpoints.values() if v.origin == "start")


@pytest.mark.parametrize("angle", np.radians([0, 20, 30, 45, 100, 260]))
def test_free_floor_between_is_not_closed_and_a_wall_is(angle: float) -> None:
    free = with_neighbor(built(room(6, 4)), angle)
    key = tuple(sorted((start_of(free), "beside")))
    assert not closed_path_test(CONFIG)(free, key)
    # A post 0.6 m from the start on the way there.
    x, y = 3 + 0.7 * math.sin(angle), 2 + 0.7 * math.cos(angle)
    for state in (OCCUPIED, UNKNOWN):
        blocked = with_neighbor(built(fill(room(6, 4), x - 0.15, y - 0.15, x + 0.15, y + 0.15, state)), angle)
        assert closed_path_test(CONFIG)(blocked, tuple(sorted((start_of(blocked), "beside"))))


def test_what_was_measured_along_it_decides_and_stale_evidence_does_not() -> None:
    graph = built(fill(room(6, 4), 3.4, 0, 3.6, 4, OCCUPIED))
    id = start_of(graph)
    shut = next(e for e in graph.evidence.values() if e.viewpoint == id and decide(e, CONFIG) != OPEN)
    near = edits.add_viewpoint(graph, Viewpoint("beside", (*shut.target, 1.2), 1.2))
    key = tuple(sorted((id, "beside")))
    assert closed_path_test(CONFIG)(near, key)
    stale = {k: replace(e, stale=True) for k, e in near.evidence.items()}
    assert not closed_path_test(CONFIG)(replace(near, evidence=stale), key)
    assert not closed_path_test(CONFIG)(replace(near, evidence={}), key)
