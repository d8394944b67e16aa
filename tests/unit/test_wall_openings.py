"""Openings of walls that the trajectory does not use: panes beside a door, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.mapping.explanation.seen_floor import SeenFloor
from nvsim.mapping.explanation.wall_openings import PossibleGlass, WallOpenings, find_walls, read_walls, write_walls

EYE = 1.4
SHOP = ((0, 0, 16, 0), (0, 0, 0, 8), (16, 0, 16, 8), (0, 8, 16, 8), (8, 0, 8, 1), (8, 3, 8, 3.1), (8, 4.3, 8, 4.4),
        (8, 7, 8, 8))  # fmt: skip
"""Walls from x, y to x, y, meters: two rooms of 8 m by 8 m. Between them are 1 m of wall, a pane of 2 m, a post, a door
of 1.2 m, a post, a pane of 2.6 m, and 1 m of wall. Nothing shows the panes."""
WALK = np.column_stack([np.arange(2.0, 14.0, 0.25), np.full(48, 3.7), np.full(48, EYE)])
"""The camera is carried through the door."""


def cloud(*walls: tuple[float, ...], height: float = 2.5) -> NDArray[np.float32]:
    """Points every 3 cm on walls from the floor to `height`."""
    found = []
    for x0, y0, x1, y1 in walls:
        along = np.linspace(0, 1, max(2, int(np.hypot(x1 - x0, y1 - y0) / 0.03)))
        z = np.arange(0, height, 0.03)
        line = np.column_stack([x0 + (x1 - x0) * along, y0 + (y1 - y0) * along])
        found.append(np.column_stack([np.repeat(line, len(z), axis=0), np.tile(z, len(along))]))
    return np.concatenate(found).astype(np.float32)


def flat(points: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.zeros(points.shape[:-1])


def openings_of(points: NDArray[np.float32], walk: NDArray[np.float64] = WALK) -> WallOpenings:
    return WallOpenings(find_walls(points, flat, walk), walk)


def crosses(openings: WallOpenings, a: tuple[float, float], b: tuple[float, float], beside_door: bool = True) -> bool:
    assert openings.leads_through_unused((*b, EYE), (*a, EYE), beside_door) is openings.leads_through_unused(
        (*a, EYE), (*b, EYE), beside_door
    )
    return openings.leads_through_unused((*a, EYE), (*b, EYE), beside_door)


def test_a_line_beside_the_door_crosses_an_opening_and_one_through_it_does_not() -> None:
    openings = openings_of(cloud(*SHOP))
    assert crosses(openings, (7, 2), (9, 2)) and crosses(openings, (6.5, 5), (9, 6.5))
    assert not crosses(openings, (7, 3.7), (9, 3.7)) and not crosses(openings, (7, 3.4), (9, 4))
    assert crosses(openings, (7.8, 1.2), (8.2, 2.8)), "although almost along the wall"
    assert not crosses(openings, (2, 2), (6, 6)) and not crosses(openings, (7.5, 1), (7.5, 7)), "within a room"


def test_a_camera_in_front_of_the_wall_does_not_cross_it() -> None:
    openings = openings_of(cloud(*SHOP))
    assert not crosses(openings, (6, 2), (7.5, 2)) and crosses(openings, (6, 2), (8.1, 2))


def test_walls_in_any_direction_are_found() -> None:
    turn = Rotation.from_euler("z", 0.4).as_matrix()
    points, walk = cloud(*SHOP) @ turn.T.astype(np.float32), WALK @ turn.T
    openings = WallOpenings(find_walls(points, flat, walk), walk)
    places = np.array([(7, 2, EYE), (9, 2, EYE), (7, 3.7, EYE), (9, 3.7, EYE)]) @ turn.T
    pane, door = (tuple(map(tuple, places[k : k + 2].tolist())) for k in (0, 2))
    assert openings.leads_through_unused(*pane, True) and not openings.leads_through_unused(*door, True)


def test_furniture_is_no_wall_and_a_lone_post_has_no_door() -> None:
    low = openings_of(np.concatenate([cloud((0, 0, 16, 0), (0, 8, 16, 8)), cloud((8, 0, 8, 3), height=1.5)]))
    assert not crosses(low, (7, 5), (9, 5), beside_door=False)
    post = openings_of(cloud((0, 0, 16, 0), (0, 8, 16, 8), (5, 6, 5.2, 6)))
    assert crosses(post, (4.5, 7), (6, 7), beside_door=False), "between the post and the wall"
    assert not crosses(post, (4.5, 7), (6, 7)), "but the trajectory uses no door in its line"


def test_a_corridor_is_no_door() -> None:
    """The line between a post and a wall meets a corridor of 1.2 m, through which the camera is carried."""
    walls = ((0, 0, 16, 0), (0, 6, 16, 6), (0, 7.2, 16, 7.2), (5, 4, 5.2, 4))
    walk = np.column_stack([np.arange(1.0, 15.0, 0.25), np.full(56, 6.6), np.full(56, EYE)])
    openings = openings_of(cloud(*walls), walk)
    assert crosses(openings, (4, 2), (6, 2), beside_door=False) and not crosses(openings, (4, 2), (6, 2))


def test_a_storey_without_walls_has_no_openings() -> None:
    nothing = openings_of(cloud((0, 0, 4, 0), height=0.2))
    assert not crosses(nothing, (1, 1), (3, 3), beside_door=False)
    assert not crosses(openings_of(np.zeros((0, 3), np.float32)), (1, 1), (3, 3), beside_door=False)


def test_each_storey_has_its_own_walls() -> None:
    """The lower storey has the panes. The camera passes through the upper storey without any wall."""
    up = WALK + np.array([0, 0, 3.0])
    walk = np.concatenate([WALK, up[::-1]])

    def floor(points: NDArray[np.floating]) -> NDArray[np.floating]:
        return np.where(points[..., 2] > 2.5, 3.0, 0.0)

    openings = WallOpenings(find_walls(cloud(*SHOP), floor, walk), walk)
    assert openings.leads_through_unused((7, 2, EYE), (9, 2, EYE), True)
    assert not openings.leads_through_unused((7, 2, EYE + 3), (9, 2, EYE + 3), True)


class Around:
    """A trajectory that makes a detour of 12 m around every line."""

    def __call__(self, a: tuple[float, ...], b: tuple[float, ...]) -> float:
        return 12.0


class Seen:
    def __init__(self, across: bool) -> None:
        self.across = across

    def is_seen_across(self, a: tuple[float, ...], b: tuple[float, ...]) -> bool:
        return self.across


def reason(a: tuple[float, float], b: tuple[float, float], openings: WallOpenings | None, seen: Seen | None) -> str:
    return PossibleGlass(Around(), openings, seen).reason((*a, EYE), (*b, EYE))  # type: ignore[arg-type]


def test_a_detour_counts_in_an_opening_or_if_no_image_looks_across() -> None:
    openings, room, pane = openings_of(cloud(*SHOP)), ((2, 2), (6, 6)), ((7, 2), (9, 2))
    assert "door" in reason(*pane, openings, Seen(True))
    assert reason(*room, openings, Seen(True)) == ""
    for less in (reason(*room, openings, Seen(False)), reason(*room, openings, None), reason(*room, None, Seen(True))):
        assert less == "skips 12 m of the trajectory"
    lone = openings_of(cloud((0, 0, 16, 0), (0, 8, 16, 8), (5, 6, 5.2, 6)))
    assert reason((4.5, 7), (6, 7), lone, Seen(True)) == "skips 12 m of the trajectory", "an opening without a door"


@pytest.mark.parametrize("wall, across", [(None, True), (6.0, False)])
def test_images_show_floor_across_unless_a_wall_is_between(wall: float | None, across: bool) -> None:
    """Three cameras at x 2 to 3 m look along x over a floor at z = 0; a wall may stand at x = `wall`."""
    intrinsics = Intrinsics(160, 120, 120.0, 120.0, 80.0, 60.0)
    cameras = [Camera(intrinsics, camera_pose(np.array([x, 0.0, EYE]), np.pi / 2)) for x in (2.0, 2.5, 3.0)]

    def depth(index: int) -> NDArray[np.float32]:
        camera = cameras[index].scaled(40, 30)
        rays = camera.rays().astype(np.float64)
        down = np.where(rays[..., 2] < -1e-6, -EYE / np.minimum(rays[..., 2], -1e-6), np.inf)
        front = np.inf if wall is None else (wall - camera.position[0]) / rays[..., 0]
        meters = np.minimum(down, front) * rays[..., 0]  # along the optical axis
        return np.where(np.isfinite(meters), meters, 0).astype(np.float32)

    seen = SeenFloor(cameras, depth, flat)
    assert seen.is_seen_across((4.0, 0.0, EYE), (8.0, 0.3, EYE)) is across
    assert seen.is_seen_across((8.0, 0.3, EYE), (4.0, 0.0, EYE)) is across, "in both directions"
    assert not seen.is_seen_across((1.0, -5.0, EYE), (1.0, 5.0, EYE)), "outside of the images"


def test_walls_are_stored_and_other_files_are_refused(tmp_path: Path) -> None:
    walls = find_walls(cloud(*SHOP), flat, WALK)
    write_walls(tmp_path / "walls.npz", walls)
    (read,) = read_walls(tmp_path / "walls.npz", WALK)
    assert np.array_equal(read.cells, walls[0].cells) and np.array_equal(read.turn, walls[0].turn)
    stacked = np.concatenate([WALK, WALK + np.array([0, 0, 3.0])])
    with pytest.raises(InputError, match="nvsim map"):
        read_walls(tmp_path / "walls.npz", stacked)
