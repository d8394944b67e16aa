"""The preset "paper" against the paper's Algorithm 1, written out line by line over a synthetic field of alpha."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray

from nvsim.geometry.directions import Sphere
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.search.graph_builder import GraphBuilder
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

PAPER = MappingConfig.paper()
TAU_ALPHA, TAU_NORMAL, TAU_DIST = 0.95, 0.85, 2.5
EXACT = 1.0  # meters


def world() -> OccupancyMap:
    occupancy = fill(room(11, 8), 4.9, 0, 5.1, 5.5, OCCUPIED)
    return fill(occupancy, 7.5, 3.0, 8.3, 3.9, OCCUPIED)


def panorama(columns: Columns, position: NDArray[np.float64]) -> NDArray[np.floating]:
    """(256, 512) alpha of the spherical view."""
    _, view = columns.panorama(Sphere(position, 512, 256), np.ones((256, 512), bool))
    assert view.alpha is not None
    return view.alpha


def roi(panorama: NDArray[np.floating], position: NDArray[np.float64], heading: float) -> tuple[float, float]:
    """Mean alpha and mean upward normal over the floor from 0.05 m ahead to the robot's radius beyond the step, as wide
    as the robot, in cells of 0.05 x 0.1 m, out of the spherical view (256, 512) of alpha."""
    forward = np.array([np.sin(heading), np.cos(heading)])
    right = np.array([forward[1], -forward[0]])
    values = []
    for row in range(27):
        for cell in range(-5, 5):
            at = position[:2] + (0.1 + 0.1 * row) * forward + (cell + 0.5) * 0.05 * right
            east, north = at - position[:2]
            turn, down = np.arctan2(east, north), np.arctan2(position[2], np.hypot(east, north))
            u = (256 + 512 * turn / (2 * np.pi) - 0.5) % 512
            v = min(128 + 256 * down / np.pi - 0.5, 255)
            u0, v0 = int(u), int(v)
            u1, v1, fu, fv = (u0 + 1) % 512, min(v0 + 1, 255), u - u0, v - v0
            top = panorama[v0, u0] * (1 - fu) + panorama[v0, u1] * fu
            bottom = panorama[v1, u0] * (1 - fu) + panorama[v1, u1] * fu
            values.append(round(float(top * (1 - fv) + bottom * fv) * 255) / 255)
    alpha = float(np.mean(values))
    return alpha, 1 - alpha  # the columns have no normals: what passes them meets the floor


def algorithm_1(
    columns: Columns, start: NDArray[np.float64], height: float
) -> tuple[list[NDArray[np.float64]], set[tuple[int, int]]]:
    """Places in the order in which they are found, and pairs of their numbers."""
    names = GraphBuilder("test")
    v, edges, q = [start[:2]], set(), deque([0])
    while q:
        current = q.popleft()
        position = np.array([*v[current], height])
        view = panorama(columns, position)
        for d in range(8):
            heading = np.radians(45 * d)
            alpha, normal = roi(view, position, heading)
            if alpha < TAU_ALPHA and normal > TAU_NORMAL:
                new = v[current] + TAU_DIST * np.array([np.sin(heading), np.cos(heading)])
                apart = [float(np.hypot(*(place - new))) for place in v]
                if min(apart) <= EXACT:  # of equally near ones the first by id
                    reached = min(
                        range(len(v)), key=lambda i: (round(apart[i], 6), names.id_at(np.append(v[i], height)))
                    )
                else:
                    v.append(new)
                    reached = len(v) - 1
                    q.append(reached)
                edges.add((min(current, reached), max(current, reached)))
    return v, edges


@pytest.mark.parametrize("start", [(2.0, 2.0), (8.5, 6.0)])
def test_the_preset_is_algorithm_1_node_by_node(start: tuple[float, float]) -> None:
    columns = Columns(world())
    position = np.array([*start, 1.2])
    walked = np.array([[2.0, 2.0, 1.2], [2.5, 2.0, 1.2]])
    graph = build_map(columns, walked, flat_floor, columns.support, PAPER, scan="test", start=position).graph
    places, edges = algorithm_1(columns, position, 1.2)
    ids = list(graph.viewpoints)
    assert len(places) > 12 and len(ids) == len(places)
    np.testing.assert_allclose([graph.viewpoints[id].position[:2] for id in ids], places, atol=1e-9)
    number = {id: i for i, id in enumerate(ids)}
    assert {tuple(sorted((number[a], number[b]))) for a, b in graph.edges} == edges


def test_the_preset_asks_for_nothing_that_the_paper_does_not_have() -> None:
    assert PAPER.rule == "mean" and not PAPER.both_ways and PAPER.margin == 0
    assert PAPER.support == 0 and not PAPER.standing and PAPER.starts == "one" and PAPER.isolated
    assert PAPER.max_distance == 0 and PAPER.lattice_offset == 0 and PAPER.jitter == 0
    assert not PAPER.settle and not PAPER.checked_merges
    assert (PAPER.tau_alpha, PAPER.tau_normal, PAPER.tau_dist) == (TAU_ALPHA, TAU_NORMAL, TAU_DIST)
    assert PAPER.merge_radius == EXACT
