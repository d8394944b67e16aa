"""Ways over known floor against the geodesics of a map, and graphs that follow them where they would go round."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from nvsim.evaluation.structure import map_structure
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.search.trajectory import Walk
from nvsim.mapping.settling.shortcuts import _EXTRA, Shortcuts, WideKnownFloor
from nvsim.occupancy.grid_ways import ERROR, Geodesics
from nvsim.occupancy.paths import standing_room
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap

HALF_WIDTH = 0.3


def cluttered(seed: int) -> OccupancyMap:
    """A room of 6 by 5 meters with boxes in it."""
    rng, occupancy = np.random.default_rng(seed), room(6, 5)
    for x, y in rng.uniform((1.2, 0), (5.5, 4.5), (7, 2)):
        width, depth = rng.uniform(0.2, 1.2, 2)
        occupancy = fill(occupancy, x, y, x + width, y + depth, OCCUPIED)
    return occupancy


def known(occupancy: OccupancyMap) -> tuple[WideKnownFloor, NDArray[np.float64]]:
    """The room of a walk along the left wall, and places all over the map."""
    xy = np.column_stack([np.full(40, 0.6), np.linspace(0.5, 4.5, 40)])
    walk = Walk(np.column_stack([xy, np.full(len(xy), 1.2)]), Columns(occupancy).support)
    x, y = np.meshgrid(np.arange(0.5, 3.5, 0.4), np.arange(0.5, 4.6, 0.4))
    return WideKnownFloor(walk, HALF_WIDTH), np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.2)])


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5, 6, 7, 8])
def test_lengths_are_the_geodesics_of_the_map(seed: int) -> None:
    occupancy = cluttered(seed)
    floor, places = known(occupancy)
    start = np.array([0.65, 2.55, 1.2])
    found = floor.lengths(start, places, 8.0)
    # Cells of 10 cm tell the room to half a cell either way.
    strict, loose = (
        Geodesics(standing_room(occupancy, HALF_WIDTH + by), occupancy).lengths(start[:2], places[:, :2])
        for by in (0.12, -0.12)
    )
    inside = strict < 7.0
    assert (found[inside] <= strict[inside] * (1 + ERROR) + 0.2).all()
    outside = np.isfinite(found) & np.isfinite(loose)
    assert (found[outside] >= loose[outside] * (1 - ERROR) - 0.2).all()


def test_a_way_keeps_to_the_middle_and_goes_around_what_was_shut() -> None:
    occupancy = fill(fill(room(6, 5), 1.5, 2.0, 4.0, 3.0, OCCUPIED), 1.5, 0.0, 4.0, 0.6, OCCUPIED)
    floor, _ = known(occupancy)
    start, end = np.array([0.8, 1.6, 1.2]), np.array([3.4, 1.3, 1.2])
    way = floor.find_path(start, end, 6.0)
    assert np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1).max() < 0.25
    between = way[(way[:, 0] > 1.8) & (way[:, 0] < 3.2)]
    np.testing.assert_allclose(between[:, 1], 1.3, atol=0.25)
    floor.close_floor(np.array([2.5, 1.3, 1.2]), 0.8)
    assert not len(floor.find_path(start, end, 3.0)), "the passage is shut, and there is no other in reach"
    assert len(WideKnownFloor(floor._walk, 0.9).find_path(start, end, 6.0)) == 0, "too narrow for a wide robot"


def test_a_window_tells_the_clearance_of_its_places_also_where_much_was_shut() -> None:
    floor, _ = known(cluttered(3))
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform((-2, -2), (7, 7), (60, 2)), rng.choice([1.2, 4.5], 60)])
    for place in places:
        floor.close_floor(place, 0.3)
    x, y = 0.6 + 0.1 * np.arange(-40, 41), 2.4 + 0.1 * np.arange(-40, 41)
    grid = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), 1.2)], axis=-1)
    before = WideKnownFloor(floor._walk, HALF_WIDTH).clearance_over(x, y, 1.2)
    expected = floor._walk.clearance_at(grid.reshape(-1, 3)).reshape(before.shape)
    np.testing.assert_array_equal(before, expected)
    for place in places[places[:, 2] == 1.2]:
        expected[np.hypot(*(grid[..., :2] - place[:2]).transpose(2, 0, 1)) < 0.3] = 0
    np.testing.assert_array_equal(floor.clearance_over(x, y, 1.2), expected)
    np.testing.assert_array_equal(floor.clearance(grid.reshape(-1, 3)).reshape(before.shape), expected)


def test_what_is_shut_out_of_reach_changes_no_way() -> None:
    floor, _ = known(room(6, 5))
    place = np.array([0.65, 2.55, 1.2])
    floor.close_floor(np.array([2.0, 2.5, 1.2]), 0.3)
    assert floor.is_affected_since(0, place, 2.0) and not floor.is_affected_since(floor.closed_count, place, 2.0)
    assert not floor.is_affected_since(0, place, 0.9), "too far"
    assert not floor.is_affected_since(0, place + [0, 0, 3.0], 2.0), "another storey"


def test_no_way_leads_where_no_floor_is_known() -> None:
    floor, _ = known(room(6, 5))
    outside = np.array([[-2.0, 2.0, 1.2], [0.8, 2.0, 4.5]])
    assert np.isinf(floor.lengths(np.array([0.8, 1.6, 1.2]), outside, 6.0)).all(), "another storey is no place here"


def offset_doors() -> OccupancyMap:
    """Two long rooms side by side, joined at their far left, and at their right through an S between two walls."""
    occupancy = room(12, 6.6)
    for y, door in ((2.6, 9.0), (3.9, 10.4)):
        wall = fill(occupancy, 1.2, y - 0.05, 12, y + 0.05, OCCUPIED)
        occupancy = fill(wall, door, y - 0.1, door + 0.8, y + 0.1, np.uint8(0))
    return occupancy


def detour_of(occupancy: OccupancyMap) -> float:
    world = Columns(occupancy)
    corners = [(11.0, 1.3), (0.6, 1.3), (0.6, 5.2), (11.0, 5.2)]
    parts = [np.linspace(a, b, 30) for a, b in zip(corners[:-1], corners[1:], strict=True)]
    walk = np.column_stack([np.concatenate(parts), np.full(90, 1.2)])
    graph = build_map(world, walk, flat_floor, world.support, MappingConfig(view_size=96), scan="test").graph
    return float(map_structure(graph, occupancy)["detour_p95"])


def test_the_graph_follows_the_ways_over_known_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    follows = detour_of(offset_doors())

    def nothing(_: Shortcuts) -> Iterator[None]:
        yield from ()

    monkeypatch.setattr(Shortcuts, "make", nothing)
    assert detour_of(offset_doors()) > 1.5 > follows, "without them this world has long ways round"


def test_legs_with_extra_room_fit_their_corridors() -> None:
    """Cells of known floor are 10 cm wide, so legs with just enough room can touch obstacles."""
    start, least = np.array([0.65, 2.55, 1.2]), {spare: [np.inf] for spare in _EXTRA}
    for seed in range(6):
        occupancy = cluttered(seed)
        floor, places = known(occupancy)
        survey = SimpleNamespace(config=MappingConfig(), walk=floor._walk, draft=None)
        shortcuts = Shortcuts(survey, None, None, None)  # type: ignore[arg-type]
        for end in places[floor.clearance(places) > 0.5]:
            for spare, rooms in least.items():
                stops = shortcuts._places(start, end, spare)
                for a, b in pairwise([start, *stops, end] if stops else []):
                    leg = a + np.linspace(0.0, 1.0, 50)[:, None] * (b - a)
                    rooms.append(occupancy_clearance(occupancy, leg).min())
    assert min(least[0.2]) >= HALF_WIDTH > min(least[0.0])


def occupancy_clearance(occupancy: OccupancyMap, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) meters from places (N, 3) to the nearest cell that is not free."""
    free = np.asarray(occupancy.cells) == FREE
    meters = distance_transform_edt(free) * occupancy.resolution
    column, row = np.floor((places[:, :2] - occupancy.origin[:2]) / occupancy.resolution).astype(int).T
    return np.asarray(meters[row, column])
