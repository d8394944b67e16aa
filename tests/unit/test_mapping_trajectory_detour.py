"""A corridor around a glass room: the map distinguishes glass from free floor that the trajectory does not cross."""

from __future__ import annotations

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray

from nvsim.graph.proposals import propose_edges
from nvsim.graph.types import NavGraph
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.explain import closed_path_test, smallest_margin
from nvsim.mapping.explanation.trajectory_detour import TrajectoryDetour
from nvsim.mapping.search.trajectory import Walk
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

EYE = 1.4


def glass_room() -> OccupancyMap:
    """10 by 8 meters; walls around a room in its middle, whose left side is of glass: free, as photographs show it."""
    occupancy = room(10, 8)
    occupancy = fill(occupancy, 3.0, 2.0, 7.0, 2.1, OCCUPIED)
    occupancy = fill(occupancy, 3.0, 5.9, 7.0, 6.0, OCCUPIED)
    return fill(occupancy, 6.9, 2.0, 7.0, 5.0, OCCUPIED)


def walked(*corners: tuple[float, float]) -> NDArray[np.float64]:
    places = [np.array(corners[0])]
    for a, b in zip(corners, corners[1:]):
        steps = max(2, int(np.hypot(b[0] - a[0], b[1] - a[1]) / 0.3))
        places += [np.array(a) + (np.array(b) - a) * k / steps for k in range(1, steps + 1)]
    return np.column_stack([places, np.full(len(places), EYE)])


WALK = walked((2, 1), (2, 7), (8, 7), (8, 5.5), (5, 5.5), (5, 3))


@pytest.fixture(scope="module")
def detour() -> TrajectoryDetour:
    return TrajectoryDetour(Walk(WALK, Columns(glass_room()).support))


def at(x: float, y: float) -> tuple[float, float, float]:
    return x, y, EYE


def test_a_way_through_the_glass_cuts_off_the_way_around(detour: TrajectoryDetour) -> None:
    meters = detour(at(2.2, 4.0), at(4.6, 4.0))
    assert meters == pytest.approx(3 + 6 + 1.5 + 3 + 1.5, abs=1.5)
    assert detour(at(4.6, 4.0), at(2.2, 4.0)) == pytest.approx(meters)


def test_ways_beside_the_trajectory_are_no_shortcuts(detour: TrajectoryDetour) -> None:
    assert detour(at(2.2, 2.0), at(1.2, 4.4)) == 0
    assert detour(at(8.2, 6.0), at(6.0, 5.4)) == 0, "through the door, as somebody walked"
    assert detour(at(4.5, 4.5), at(5.6, 3.2)) == 0
    assert detour(at(2.2, 4.0), at(2.2, 4.0)) == 0


def test_a_pane_may_stand_anywhere_between_parts_that_are_led_around(detour: TrajectoryDetour) -> None:
    assert detour(at(2.7, 3.0), at(2.7, 4.5)) > 10, "right before the pane, as nobody walked there"
    assert detour(at(2.3, 3.0), at(2.3, 4.5)) == 0, "beside the trajectory"
    assert detour(at(1.3, 3.0), at(1.3, 4.5)) == 0, "beyond it there is no other part to see"


def test_who_sees_none_of_the_trajectory_is_not_judged(detour: TrajectoryDetour) -> None:
    assert detour(at(-3.0, 4.0), at(2.2, 4.0)) == 0


def test_parts_that_the_trajectory_does_not_join_are_far_from_each_other() -> None:
    apart = np.concatenate([walked((1, 1), (1, 7)), walked((9, 7), (9, 1))])
    detour = TrajectoryDetour(Walk(apart, Columns(glass_room()).support))
    assert detour(at(1.4, 1.0), at(8.6, 1.0)) == np.inf


def through_the_glass(graph: NavGraph) -> list[float]:
    """Metres from the pane to the nearer end of every edge through it."""
    ends = np.array([[graph.viewpoints[id].position[:2] for id in key] for key in graph.edges])
    across = (ends[:, 0, 0] - 3.0) * (ends[:, 1, 0] - 3.0) < 0
    across &= (ends[..., 1] > 2.1).all(axis=1) & (ends[..., 1] < 5.9).all(axis=1)
    return sorted(np.abs(ends[across, :, 0] - 3.0).min(axis=1).tolist())


def test_without_a_scan_most_edges_through_the_glass_are_left_out() -> None:
    world, config = Columns(glass_room()), MappingConfig(view_size=96)

    def built(scanned: bool, config: MappingConfig = config) -> NavGraph:
        return build_map(
            world, WALK, flat_floor, world.support, config, scan="test", scanned=scanned
        ).graph  # fmt: skip

    scanned, blind = built(True), built(False)
    left = through_the_glass(blind)
    assert len(left) <= len(through_the_glass(scanned)) / 2
    assert all(meters < 1.0 for meters in left), "who stands right beside it may belong to the other side"
    gone = scanned.edges.keys() - blind.edges.keys()
    assert blind.edges.keys() <= scanned.edges.keys()
    stayed = [key for key in gone if all(id in blind.viewpoints for id in key)]
    around = [e for e in blind.evidence.values() if e.decision == "around"]
    assert len(around) >= len(stayed) > 0, "of every one, but what viewpoints had that lost all edges"
    asked, proposed = (
        closed_path_test(config),
        {p.edge: p.words for p in propose_edges(blind, margin=smallest_margin(config))},
    )
    assert all(asked(blind, key) for key in stayed), "nobody is told to join what stands so near"
    assert all("glass" in proposed[key] for key in stayed if key in proposed)
    kept = built(False, MappingConfig(view_size=96, around=0.0))
    assert kept.edges.keys() == scanned.edges.keys()
