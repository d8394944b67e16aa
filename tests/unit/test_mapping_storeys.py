"""Corridors, the trajectory and evidence where storeys lie over one another: a stair between two floors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from stairwell import SLOPE, known_floor, stairwell

from nvsim.geometry.sampling import places_between
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor, Lattice
from nvsim.mapping.evidence.measuring import Measurements
from nvsim.mapping.evidence.new_viewpoints import measure_new_viewpoints
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.mapping.search.trajectory import Walk
from nvsim.render.backends import RenderOutput

EYE = 1.3
FLOOR = stairwell()
SUPPORT = known_floor(FLOOR)


def true_floor(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Along the stair and its landings."""
    return np.clip(SLOPE * (x - 2), 0, 3)


def walk() -> NDArray[np.float64]:
    """Around the lower room, up the stair, around the upper one."""
    t = np.linspace(0, 2 * np.pi, 60)
    x = np.arange(1.0, 8.0, 0.35)
    stair = np.column_stack([x, np.full(len(x), 0.5), true_floor(x) + EYE])
    lower = np.column_stack([3 + 2.5 * np.cos(t), 3.5 + 1.5 * np.sin(t), np.full(60, EYE)])
    upper = np.column_stack([6 + 2.5 * np.cos(t), -2 + 1.2 * np.sin(t), np.full(60, 3 + EYE)])
    over = np.column_stack([8 + 0 * t, np.linspace(0.5, 4, 60), np.full(60, 3 + EYE)])
    return np.concatenate([lower, stair, over, upper])


@pytest.mark.parametrize(("start", "end"), [(0.5, 3.0), (3.4, 5.9), (5.5, 8.0), (8.0, 5.5), (4.6, 2.1), (4.2, 1.7)])
def test_a_corridor_follows_the_floor_up_and_down_a_stair(start: float, end: float) -> None:
    corridor = Corridor((start, 0.5), (end, 0.5), float(true_floor(np.array(start))) + EYE)
    ground = corridor.ground(FLOOR.height_at)
    np.testing.assert_array_equal(ground[..., :2], corridor.cells())
    middle = ground[:, 5:13]  # within the walls beside the stair
    np.testing.assert_allclose(middle[..., 2], true_floor(middle[..., 0]), atol=0.07)
    assert corridor.end(FLOOR.height_at) == pytest.approx(float(true_floor(np.array(end))), abs=0.07)
    assert SUPPORT.is_supported(middle).all()


@pytest.mark.parametrize(("eye", "height"), [(EYE, 0.0), (3 + EYE, 3.0)])
def test_a_corridor_in_a_room_stays_on_its_storey(eye: float, height: float) -> None:
    corridor = Corridor((8.0, 4.0), (10.5, 4.0), eye)
    assert (corridor.ground(FLOOR.height_at)[..., 2] == height).all()
    assert SUPPORT.is_supported(corridor.ground(FLOOR.height_at)).all()


def test_the_nearest_camera_is_that_of_the_storey() -> None:
    path = Walk(walk(), SUPPORT.is_supported)
    assert [path.storey(z) for z in (0.0, EYE, 2.5, 3.2, 3 + EYE)] == [0, 0, 0, 1, 1]
    below, above = np.array([8.0, 3.5, EYE]), np.array([8.0, 3.5, 3 + EYE])
    assert path.height(below) == pytest.approx(EYE) and path.distance(below) == pytest.approx(2.5, abs=0.05)
    assert path.height(above) == pytest.approx(3 + EYE) and path.distance(above) < 0.05
    assert path.distance(above[:2]) < 0.05, "seen from above alone it is a camera of either"
    on_stair = np.array([5.2, 0.5, true_floor(np.array(5.2)) + EYE])
    assert path.height(on_stair) == pytest.approx(on_stair[2], abs=0.15)
    beside = np.array([5.2, 1.4, EYE])  # in the lower room, behind the wall along the stair
    assert path.height(beside) == pytest.approx(EYE)


def test_lines_and_clearance_are_those_of_the_storey() -> None:
    path = Walk(walk(), SUPPORT.is_supported)
    a, b = np.array([1.5, 3.0, EYE]), np.array([6.0, 3.0, EYE])
    up = np.array([0, 0, 3.0])
    assert path.is_line_known(a, b) and not path.is_line_known(a + up, b + up)
    foot, head = np.array([1.2, 0.5, EYE]), np.array([7.8, 0.5, 3 + EYE])
    assert path.is_line_known(foot, head), "up the stair"
    for place, clearance in zip(path.places, path.clearance, strict=True):
        on_stair = 2.3 < place[0] < 6.7 and 0 < place[1] < 1
        assert 0.35 < clearance < 0.7 if on_stair else clearance > 0.25
    rooms = path.positions_beside(0.3, 0.5)
    assert {round(z, 1) for z in rooms[:, 2] if abs(z - EYE) < 0.01 or abs(z - 3 - EYE) < 0.01} == {EYE, 3 + EYE}
    assert SUPPORT.is_supported(rooms).all()


def test_of_one_storey_the_height_of_a_place_counts_for_nothing() -> None:
    flat = walk()[:60]
    known = SUPPORT.storeys[0].is_supported
    path = Walk(flat, known)
    for place in np.random.default_rng(0).uniform((-1, 0, -5), (7, 6, 9), (50, 3)):
        nearest = float(np.hypot(*(flat[:, :2] - place[:2]).T).min())
        assert path.distance(place) == path.distance(place[:2]) == pytest.approx(nearest)
        assert path.height(place) == path.height(place[:2]) == EYE and path.storey(place[2]) == 0


class Clear:
    """Views in which nothing stands."""

    def views(self, position, cameras, masks):  # type: ignore[no-untyped-def]
        shape = masks[0].shape
        return 0, [RenderOutput(alpha=np.zeros(shape, np.float32), normal=np.zeros((*shape, 3), np.float32))] * len(
            masks
        )


def viewpoint(id: str, x: float, y: float, floor: float) -> Viewpoint:
    return Viewpoint(id, (x, y, floor + EYE), EYE)


def test_a_corridor_does_not_join_what_lies_over_one_another() -> None:
    config = MappingConfig()
    measurements = Measurements(Clear(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config))
    a, same, over = viewpoint("a", 8, 2, 0), viewpoint("b", 9, 3, 0), viewpoint("c", 9, 3, 3)
    assert (
        measurements.corridor_evidence(a, same).support.all()
        and not measurements.corridor_evidence(a, over).support.any()
    )
    assert measurements.corridor_evidence(viewpoint("d", 8, 2, 3), over).support.all()
    up = measurements.corridor_evidence(viewpoint("e", 3.4, 0.5, 0.84), viewpoint("f", 5.8, 0.5, 2.28)).support
    assert up[:, 5:13].all(), "up the stair they are joined"


def test_a_step_arrives_on_the_floor_that_it_follows() -> None:
    config = MappingConfig()
    measurements = Measurements(Clear(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config))
    for x, y, floor, target, arrives in (
        (1.0, 0.5, 0.0, (3.5, 0.5), 0.9),
        (6.0, 0.5, 2.4, (8.5, 0.5), 3.0),
        (4.2, 0.5, 1.32, (1.7, 0.5), 0.0),
        (8.0, 2.0, 0.0, (8.0, 4.5), 0.0),
        (8.0, 2.0, 3.0, (8.0, 4.5), 3.0),
    ):
        found = measurements.arrival(viewpoint("v", x, y, floor), target)
        assert found[:2] == target and found[2] == pytest.approx(arrives + EYE, abs=0.07)


class Walls(Clear):
    """Views of nothing but Gaussians, from two models; the second was trained on the lower storey alone."""

    def views(self, position, cameras, masks):  # type: ignore[no-untyped-def]
        return 0, self.views_of(0, cameras, masks)

    def views_of(self, submap, cameras, masks):  # type: ignore[no-untyped-def]
        shape = masks[0].shape
        return [RenderOutput(alpha=np.ones(shape, np.float32), normal=np.zeros((*shape, 3), np.float32))] * len(masks)

    def second_submap(self, position):  # type: ignore[no-untyped-def]
        return 1

    def trained_at(self, submap, positions):  # type: ignore[no-untyped-def]
        return positions[:, 2] < 1.0 + EYE

    def gaussians(self, submap):  # type: ignore[no-untyped-def]
        raise AssertionError("nobody asked for the slice")


def test_the_last_steps_that_are_seen_edge_on_from_below_are_left_to_the_corridor_back() -> None:
    low, high = viewpoint("a", 4.2, 0.5, 1.32), viewpoint("b", 6.7, 0.5, 2.82)
    config = MappingConfig()
    measurements = Measurements(Walls(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config))
    up, down = measurements.corridor_evidence(low, high), measurements.corridor_evidence(high, low)
    corridor = Corridor((4.2, 0.5), (6.7, 0.5), 1.32 + EYE)
    ground = corridor.ground(FLOOR.height_at)[:, 5:13]
    over, distance = 1.32 + EYE - ground[..., 2], np.hypot(ground[..., 0] - 4.2, ground[..., 1] - 0.5)
    np.testing.assert_array_equal(up.alpha[:, 5:13], np.where(over < 0.15 * distance, 0, 255))
    assert (over < 0).any() and (over > 0.15 * distance).any(), "some of it lies over the eye, and some is seen"
    assert (down.alpha == 255).all(), "from above all of it is seen"
    alone = MappingConfig(both_ways=False)
    paper = Measurements(Walls(), FLOOR.height_at, SUPPORT.is_supported, alone, Lattice(alone))
    assert (paper.corridor_evidence(low, high).alpha == 255).all(), "where nobody asks for the way back it is no floor"


class Doubted(Walls):
    """The same, but the first model shows nothing."""

    views = Clear.views


def test_a_model_has_an_opinion_on_the_part_of_a_corridor_that_it_was_trained_on() -> None:
    config = MappingConfig()
    measurements = Measurements(Doubted(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config))
    down = measurements.corridor_evidence(viewpoint("b", 4.6, 0.5, 1.56), viewpoint("a", 2.2, 0.5, 0.12))
    floor = Corridor((4.6, 0.5), (2.2, 0.5), 1.56 + EYE).ground(FLOOR.height_at)[:, 9, 2]
    assert down.second is not None and (down.alpha == 0).all()
    np.testing.assert_array_equal(down.second.alpha[:, 9], np.where(floor < 1.0, 255, 0))
    assert 5 < (floor < 1.0).sum() < len(floor) - 5


def test_what_somebody_walked_over_is_floor_by_a_stair_and_nowhere_else() -> None:
    config = MappingConfig()
    traversed = TraversedFloor(walk())
    measurements = Measurements(Walls(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config), (), traversed)
    low, high = viewpoint("a", 3.2, 0.5, 0.72), viewpoint("b", 4.8, 0.5, 1.68)
    for corridor in (measurements.corridor_evidence(low, high), measurements.corridor_evidence(high, low)):
        assert (corridor.alpha[:16, 5:13] == 0).all(), "the cameras climbed along y = 0.5"
        assert (corridor.alpha[:16, [0, 17]] == 255).all(), "and not within reach of the walls"
    room = viewpoint("c", 5.5, 3.5, 0), viewpoint("d", 4.5, 4.7, 0)
    assert (measurements.corridor_evidence(*room).alpha == 255).all(), "in a room the views decide, walked or not"
    unsupported = MappingConfig(support=0)
    paper = Measurements(
        Walls(), FLOOR.height_at, SUPPORT.is_supported, unsupported, Lattice(unsupported), (), traversed
    )
    assert (paper.corridor_evidence(high, low).alpha == 255).all(), "and without known floor everywhere"


def test_trodden_is_what_lies_beside_a_carried_camera_and_not_where_nobody_walked_between_two() -> None:
    path = np.array([[0, 0, 1.3], [1, 0, 1.3], [1, 1, 1.3], [5, 1, 1.3], [5, 1, 4.3]])
    places = np.random.default_rng(0).uniform((-1, -1, -2), (6, 3, 5), (2000, 3))
    t = np.linspace(0, 1, 400)[:, None]
    slow = np.concatenate([a + t * (b - a) for a, b in ((path[0], path[1]), (path[1], path[2]))] + [path])
    over = slow[:, 2] - places[:, 2:]
    near = np.linalg.norm(slow[:, :2] - places[:, None, :2], axis=-1)
    by = ((near < 0.4) & (over > 0.3) & (over < 2.5)).any(axis=1)
    edge = np.abs(np.where((over > 0.3) & (over < 2.5), near, 9).min(axis=1) - 0.4) < 0.01
    np.testing.assert_array_equal(TraversedFloor(path).is_traversed(places)[~edge], by[~edge])
    assert by.any() and not TraversedFloor(path).is_traversed(np.array([3.0, 1.0, 0.0]))
    assert TraversedFloor(path[:1]).is_traversed(np.array([0.1, 0.0, 0.0]))


def test_without_a_scan_nothing_stands_where_somebody_walked() -> None:
    places = np.random.default_rng(0).uniform((2.5, -0.5, -0.5), (5.5, 1.5, 2.0), (500, 3))
    told, silent = TraversedFloor(walk(), scanned=False), TraversedFloor(walk())
    assert not silent.is_surely_traversed(places).any() and silent.is_traversed(places).any()
    found = told.is_surely_traversed(places)
    assert found.any() and (told.is_traversed(places) | ~found).all(), "nor where it would not beside a stair"
    config = MappingConfig()
    room = viewpoint("c", 1.4, 0.5, 0), viewpoint("d", 0.4, 0.5, 0)
    assert told.is_surely_traversed(np.array([[1.0, 0.5, 0.0]])).all()
    alphas = [
        Measurements(Walls(), FLOOR.height_at, SUPPORT.is_supported, config, Lattice(config), (), traversed)
        .corridor_evidence(*room)
        .alpha
        for traversed in (told, silent)
    ]
    assert (alphas[0][:6, 5:13] == 0).all() and (alphas[1] == 255).all()


def test_the_nearest_camera_tells_whether_somebody_walked_over_a_place() -> None:
    rng = np.random.default_rng(1)
    path = np.cumsum(rng.normal(size=(200, 3)) * [0.3, 0.3, 0.05], axis=0) + [0, 0, 1.5]
    places = rng.uniform(path.min(axis=0) - 2, path.max(axis=0) + 2, (40, 50, 3)) * [1, 1, 0.3]
    walked = places_between(path, 0.1, 1.5)
    away = np.linalg.norm(places[..., None, :2] - walked[:, :2], axis=-1)
    over = walked[away.argmin(axis=-1), 2] - places[..., 2]
    by = (away.min(axis=-1) < 0.4) & (over > 0.3) & (over < 2.5)
    found = TraversedFloor(path, scanned=False).is_surely_traversed(places)
    assert by.any() and not by.all()
    np.testing.assert_array_equal(found, by)
    assert TraversedFloor(path[:1], scanned=False).is_surely_traversed(path[0] * [1, 1, 0])


def test_new_viewpoints_by_a_stair_are_measured_as_the_builder_measures_them() -> None:
    ends = {"a": viewpoint("a", 3.2, 0.5, 0.72), "b": viewpoint("b", 4.8, 0.5, 1.68)}
    graph, config = NavGraph("stair", ends), MappingConfig(second_opinion=False)
    place = Walls(), FLOOR.height_at, SUPPORT.is_supported, config
    assert measure_new_viewpoints(graph, ["b"], *place, traversed=TraversedFloor(walk())).proposed == (("a", "b"),)
    assert measure_new_viewpoints(graph, ["b"], *place).proposed == ()
