"""Floors are called what they are made of where joints say so, and by their color where not; stairs are apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.instructions.cues import Cue, cues_along
from nvsim.r2r.surroundings.doorways import doorways_between, kinds_of
from nvsim.r2r.surroundings.floor_kinds import FLOORS, floor_kinds, floors_differ
from nvsim.r2r.surroundings.layers import CELL, Layers, layers_of
from nvsim.r2r.surroundings.survey import Surroundings
from nvsim.r2r.surroundings.visibility import PIXEL, FloorPatch, ViewFromViewpoint, floor_patch

Paint = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
SIDE = 3.2
BROWN, GRAY, GREEN = np.array([143.0, 107, 74]), np.array([128.0, 128, 128]), np.array([50.0, 110, 60])


def hashed(i: NDArray[np.int64]) -> NDArray[np.float64]:
    return (i * 7919 % 101) / 101 - 0.5


def planks(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    lane = np.floor(y / 0.12).astype(int)
    return BROWN * (1 + 0.3 * hashed(lane * 13 + np.floor(x / 1.2 + 0.37 * lane).astype(int)))[..., None]


def tiles(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    i, j = np.floor(x / 0.3).astype(int), np.floor(y / 0.3).astype(int)
    joint = (np.mod(x, 0.3) < 0.02) | (np.mod(y, 0.3) < 0.02)
    return GRAY * np.where(joint, 0.6, 1 + 0.15 * hashed(i * 31 + j * 17))[..., None]


def speckled(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return GRAY * (1 + 0.2 * np.random.default_rng(0).standard_normal(x.shape).clip(-2, 2))[..., None]


def plain(color: NDArray[np.float64]) -> Paint:
    return lambda x, y: np.broadcast_to(color, (*x.shape, 3))


def layers(paint: Paint, turned: float = 0.0) -> Layers:
    """A floor of 3.2 by 3.2 m seen by one viewpoint in its middle, its pattern turned by so many degrees."""
    along = (np.arange(round(SIDE / PIXEL)) + 0.5) * PIXEL
    x, y = np.meshgrid(along, along)
    c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    image = paint(c * x - s * y + 20, s * x + c * y + 20).clip(0, 255).astype(np.uint8)
    viewpoint = Viewpoint("v", (SIDE / 2, SIDE / 2, 1.5))
    seen = ViewFromViewpoint(
        viewpoint,
        np.zeros((4, 24), np.float32),
        np.zeros((0, 3), np.float32),
        np.zeros((0, 3), np.uint8),
        FloorPatch((0.0, 0.0), image, np.ones(x.shape, bool)),
    )
    cells = round(SIDE / CELL)
    column, row = np.meshgrid(np.arange(cells), np.arange(cells))
    level = np.full(cells * cells, 6)  # from 0 to 5 cm above the floor
    voxels = np.column_stack([column.ravel(), row.ravel(), level]).astype(np.int32)
    step = round(CELL / PIXEL * 2) / 2
    at = (np.arange(cells) * step + step / 2).astype(int)
    colors = image[at][:, at].reshape(-1, 3).astype(np.float32)
    return Layers((seen,), 0.0, (0.0, 0.0), voxels, colors, (cells, cells), (2.1, 2.6))


@pytest.mark.parametrize("turned", [0.0, 25.0, 45.0, 90.0])
@pytest.mark.parametrize(
    "paint, name", [(planks, "wooden"), (tiles, "tiled"), (speckled, "gray"), (plain(GRAY), "gray"),
                    (plain(BROWN), "brown")],
)  # fmt: skip
def test_joints_say_what_a_floor_is_made_of_and_nothing_else_does(paint: Paint, name: str, turned: float) -> None:
    kinds = floor_kinds(layers(paint, turned), np.zeros((64, 64), bool))
    middle = kinds[12:-12, 12:-12]
    assert (middle == FLOORS.index(name)).mean() > 0.6
    others = {FLOORS[i] for i in np.unique(middle) if i >= 0} - {name}
    assert not any(floors_differ(name, other) for other in others)


def test_a_colored_rectangle_on_another_floor_is_a_rug_and_between_walls_a_room() -> None:
    def carpeted(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        on = (np.abs(x - 20 - SIDE / 2) < 0.7) & (np.abs(y - 20 - SIDE / 2) < 0.6)
        return np.where(on[..., None], GREEN, planks(x, y))

    seen, walls = layers(carpeted), np.zeros((64, 64), bool)
    assert FLOORS[floor_kinds(seen, walls)[32, 32]] == "green rug"
    walls[16:18, 16:48] = walls[46:48, 16:48] = walls[16:48, 16:18] = walls[16:48, 46:48] = True
    assert FLOORS[floor_kinds(seen, walls)[32, 32]] == "green"


@pytest.mark.parametrize(
    "one, other, differ",
    [("wooden", "tiled", True), ("wooden", "brown", False), ("tiled", "gray", False), ("tiled", "brown", True),
     ("green rug", "green", False), ("green rug", "tiled", True), ("brown", "gray", True)],
)  # fmt: skip
def test_floors_that_may_be_one_are_not_told_apart(one: str, other: str, differ: bool) -> None:
    assert floors_differ(one, other) == floors_differ(other, one) == differ


@pytest.mark.parametrize(
    "floors, cue",
    [  # with a doorway after 1 m
        (["wooden"] * 4 + [""] + ["brown", "gray"] + ["tiled"] * 4, Cue("floor", "wooden to tiled")),
        (["wooden"] * 5 + ["green rug"] * 5, Cue("rug", "onto green rug")),
        (["green rug"] * 5 + ["tiled"] * 5, Cue("rug", "off green rug")),
        (["tiled"] * 5 + ["green rug"] * 5 + ["tiled"] * 5, Cue("rug", "across green rug")),
        (["wooden"] * 5 + ["tiled"] * 5 + ["wooden"] * 5, None),
        (["wooden"] * 5 + ["tiled"] * 2, None),
        (["brown"] * 5 + ["wooden"] * 5, None),
    ],
)
def test_a_change_of_the_floor_is_said_where_it_is_for_good(floors: list[str], cue: Cue | None) -> None:
    seen = Surroundings(meters={("a", "b"): 3.0}, doors={("a", "b"): (1.0,)}, passed={("a", "b"): ()},
                        floors={("a", "b"): tuple(floors)})  # fmt: skip
    assert cues_along(["a", "b"], 0.0, seen) - {Cue("through", "1")} == (frozenset([cue]) if cue else frozenset())


def test_a_change_of_the_floor_inside_a_room_is_not_said_because_it_may_be_a_rug() -> None:
    def cues(doors: tuple[float, ...]) -> set[Cue]:
        floors = {("a", "b"): ("wooden",) * 8 + ("tiled",) * 8}
        seen = Surroundings(meters={("a", "b"): 3.2}, doors={("a", "b"): doors}, passed={("a", "b"): ()}, floors=floors)
        return {cue for cue in cues_along(["a", "b"], 0.0, seen) if cue.kind == "floor"}

    assert cues((1.6,)) == cues((2.0,)) == {Cue("floor", "wooden to tiled")}
    assert cues(()) == cues((0.4,)) == set()


def test_a_patch_is_the_floor_from_above() -> None:
    """The middle of the patch is the floor straight below the viewpoint. Pixels that are farther away than the floor
    are not part of the patch."""
    side = 32
    strip = np.zeros((side, 6 * side, 3), np.uint8)
    strip[:, 5 * side :] = 200  # the face that looks down
    viewpoint = Viewpoint("v", (10.0, 20.0, 1.5), height=1.5)
    patch = floor_patch(viewpoint, strip, np.full((side, 6 * side), 1.5))
    count = patch.colors.shape[0]
    assert patch.low == pytest.approx((8.4, 18.4)) and (patch.colors[count // 2, count // 2] == 200).all()
    assert patch.seen[count // 2, count // 2] and not patch.seen[0, 0]  # 1.5 m below, and farther in the corner


def seen_at(id: str, x: float, floor: float) -> ViewFromViewpoint:
    empty = FloorPatch((0.0, 0.0), np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), bool))
    viewpoint = Viewpoint(id, (x, 0.0, floor + 1.5), height=1.5)
    nothing = np.zeros((0, 3), np.float32)
    return ViewFromViewpoint(viewpoint, np.zeros((4, 24), np.float32), nothing, nothing.astype(np.uint8), empty)


def test_viewpoints_on_stairs_belong_to_no_storey_and_do_not_join_two() -> None:
    floors = [0.0, 0.0, 0.0, 0.6, 1.2, 1.8, 2.4, 3.0, 3.0, 3.0]
    seen = [seen_at(f"v{i}", float(i), floor) for i, floor in enumerate(floors)]
    edges = [edge(f"v{i}", f"v{i + 1}") for i in range(len(floors) - 1)]
    graph = NavGraph("house", {one.viewpoint.id: one.viewpoint for one in seen}, {e.key: e for e in edges})
    storeys = list(layers_of(seen, graph))
    assert [[one.viewpoint.id for one in layers.seen] for layers in storeys] == [["v0", "v1", "v2"], ["v7", "v8", "v9"]]
    assert [layers.floor for layers in storeys] == [0.0, 3.0]


def test_a_corridor_that_bends_is_one_at_its_bend_and_lamps_are_no_walls() -> None:
    """A corridor 1.7 m wide around a corner, and a room of 4 by 4 m with something that hangs in its middle."""
    walls = np.ones((240, 240), bool)
    walls[20:54, 20:220] = walls[20:220, 20:54] = False  # cells of 5 cm
    walls[100:180, 100:180] = False
    walls[138:144, 138:144] = True
    seen = Layers((), 0.0, (0.0, 0.0), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32), (240, 240), (2.1, 2.6))
    places = np.array([[1.85, 1.85], [6.0, 1.85], [1.85, 9.0], [7.0, 6.0], [5.4, 5.4]])
    assert kinds_of(walls, seen, places) == ["corridor", "corridor", "corridor", "room", "room"]


def test_a_lintel_between_walls_that_go_on_is_no_doorway() -> None:
    """A beam across a corridor 1.3 m wide, and the same lintel in a wall between two rooms."""
    seen = Layers((), 0.0, (0.0, 0.0), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.float32), (120, 120), (2.1, 2.6))
    a, b = np.array([1.0, 3.0]), np.array([5.0, 3.0])
    corridor = np.zeros((120, 120), bool)  # cells of 5 cm
    corridor[44:47] = corridor[73:76] = True
    room = np.zeros((120, 120), bool)
    room[:47, 59:62] = room[73:, 59:62] = True
    beam = np.zeros((120, 120), bool)
    beam[47:73, 59:62] = True
    assert doorways_between(corridor | beam, corridor, seen, a, b) == []
    assert doorways_between(room | beam, room, seen, a, b) == pytest.approx([2.0], abs=0.1)
