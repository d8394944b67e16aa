"""The axes of a building from its images: up, the camera height above the floor, and the direction of the walls."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from known_reconstruction import HEIGHT, WIDTH, camera, facing, places_in, pose, reconstruction, seen_from, turned
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.capture.alignment import HELD_UPRIGHT
from nvsim.capture.vertical_edges import Lines, vertical_from_lines
from nvsim.geometry.camera import quarter_turns
from nvsim.poses.building_frame import camera_height, lines_of, vertical_of, wall_direction
from nvsim.poses.piece_reliability import Observations, observations_of

HIGH = 1.5  # meters of the camera above the floor
UP = np.array([0, 0, 1.0])


def looks(count: int, wide: float = 2.0) -> NDArray[np.float64]:
    """(count, 3) directions of a person who looks around by `wide` radians, up and down a little."""
    yaw = np.linspace(0, wide, count)
    return np.stack([np.cos(yaw), np.sin(yaw), -0.25 + 0.05 * np.sin(3 * yaw)], axis=1)


def walk(world: NDArray[np.float64], table: bool = False, floor: int = 700, mirrored: int = 0) -> Observations:
    """16 images in a room, in a world that is turned by `world`: floor, walls, a mirror image below the floor."""
    rng = np.random.default_rng(0)
    poses = {
        k + 1: pose(facing(ahead), np.array([0.15 * k, 0.1 * np.sin(k), HIGH + 0.02 * np.sin(2 * k)]))
        for k, ahead in enumerate(looks(16))
    }
    parts = [
        np.column_stack([rng.uniform(-2, 7, (floor, 1)), rng.uniform(-3, 6, (floor, 1)), np.zeros(floor)]),
        np.column_stack([np.full(400, 6.0), rng.uniform(-3, 6, 400), rng.uniform(0, 2.6, 400)]),
        np.column_stack([rng.uniform(-2, 6, 400), np.full(400, 5.0), rng.uniform(0, 2.6, 400)]),
        rng.uniform((-2, -3, -2.6), (7, 6, -0.2), (mirrored, 3)),
    ]
    if table:
        parts.append(np.column_stack([rng.uniform(1.5, 4, 150), rng.uniform(1, 4, 150), np.full(150, 0.75)]))
    points = np.concatenate(parts) + rng.normal(0, 0.005, (sum(map(len, parts)), 3))
    shown_by, places = seen_from(poses, points, 9.0)
    moved = {
        n: pose(p.rotation.matrix() @ world.T, world @ (-p.rotation.matrix().T @ p.translation))
        for n, p in poses.items()
    }
    return observations_of(reconstruction(moved, points @ world.T, shown_by, places))


def degrees(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ other, -1, 1))))


def test_up_is_across_the_sideways_axes_of_level_cameras() -> None:
    rng = np.random.default_rng(1)
    world = turned(70, (1, 2, -1))
    rolled = [turned(float(rng.normal(0, 1)), (0, 0, 1)) @ facing(ahead) @ world.T for ahead in looks(40)]
    up = vertical_of(np.array(rolled))
    assert up is not None and degrees(up, world @ UP) < 1.0
    sideways = vertical_of(quarter_turns(-HELD_UPRIGHT) @ np.array(rolled))
    assert sideways is not None and degrees(sideways, world @ UP) < 1.0
    assert vertical_of(np.array([facing(np.array([0, 1, 0.02 * k])) for k in range(20)])) is None


@pytest.mark.parametrize("tilt", [0.0, 1.5, -2.0])
@pytest.mark.parametrize("table", [False, True])
def test_the_floor_tells_height_and_up_even_if_up_was_a_little_wrong(tilt: float, table: bool) -> None:
    world = turned(40, (1, -1, 2))
    seen = walk(world, table)
    up = turned(tilt, (1, 0.3, 0)) @ world @ UP
    found = camera_height(seen, np.ones(len(seen.numbers), bool), up)
    assert found is not None
    assert found[0] == pytest.approx(HIGH, rel=0.01)
    assert degrees(found[1], world @ UP) < 0.3


def test_a_mirror_below_the_floor_is_not_the_floor() -> None:
    seen = walk(np.eye(3), mirrored=250)
    found = camera_height(seen, np.ones(len(seen.numbers), bool), UP)
    assert found is not None and found[0] == pytest.approx(HIGH, rel=0.01)


def test_no_floor_is_no_height() -> None:
    seen = walk(np.eye(3), floor=0)
    assert camera_height(seen, np.ones(len(seen.numbers), bool), UP) is None
    assert camera_height(walk(np.eye(3)), np.zeros(16, bool), UP) is None


def draw(path: Path, rotation: NDArray[np.float64], segments: NDArray[np.float64]) -> None:
    """An image with world segments (N, 2, 3) as black lines, seen from (0, 0, 1.5)."""
    image = np.full((HEIGHT, WIDTH), 220, np.uint8)
    one = pose(rotation, np.array([0, 0, HIGH]))
    for segment in segments:
        along = segment[0] + np.linspace(0, 1, 60)[:, None] * (segment[1] - segment[0])
        places, shown = places_in(one, along)
        if shown.sum() > 1:
            a, b = (tuple(int(v) for v in np.rint(places[shown][k])) for k in (0, -1))
            cv2.line(image, a, b, 30, 2, cv2.LINE_AA)
    assert cv2.imwrite(str(path), image)


@pytest.mark.parametrize("yaw", [3.0, 31.0, 88.5])
def test_walls_run_along_the_level_lines_of_the_images(tmp_path: Path, yaw: float) -> None:
    rng = np.random.default_rng(2)
    along = Rotation.from_rotvec(np.radians(yaw) * UP).as_matrix()
    segments = []
    for k in range(24):  # skirting boards, shelves and ceilings of a room, and upright door frames
        axis, side = k % 2, 3.0 if k % 4 < 2 else -3.0
        height = (0.0, 0.8, 2.0, 2.6)[k % 4]
        start, end = np.array([-2.5, side, height]), np.array([2.5, side, height])
        if axis:
            start, end = start[[1, 0, 2]], end[[1, 0, 2]]
        segments += [(start, end), (end * (1, 1, 0), end * (1, 1, 0) + (0, 0, 2.1))]
    segments += [(a := rng.uniform((-3, -3, 0), (3, 3, 2)), a + rng.uniform(-1, 1, 3)) for _ in range(12)]
    segments += [(a := np.array([3 * np.cos(k), 3 * np.sin(k), 0.9]), a + (0, 0, 1.2)) for k in range(12)]  # windows
    world = turned(25, (2, 1, 0))
    lines = np.array(segments) @ along.T
    views = []
    for k, ahead in enumerate(looks(6, 5.0)):
        draw(tmp_path / f"{k}.png", facing(ahead), lines)
        views.append((f"{k}.png", camera(), facing(ahead) @ world.T))
    shown = lines_of(tmp_path, views)
    edges = vertical_from_lines(shown, turned(2, (1, 1, 0.5)) @ world @ UP)
    assert edges is not None and edges[1] < np.radians(0.2)
    assert degrees(edges[0], world @ UP) < 0.15
    found = wall_direction(shown, world @ UP)
    assert found is not None
    level = world.T @ found
    assert abs(level[2]) < 1e-9
    assert abs((np.degrees(np.arctan2(level[1], level[0])) - yaw + 45) % 90 - 45) < 0.6


def test_lines_in_all_directions_tell_no_walls(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    starts = rng.uniform((-4, -4, 0), (4, 4, 2.5), (150, 3))
    angle = rng.uniform(0, 2 * np.pi, 150)
    ends = starts + 1.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    views = []
    for k, ahead in enumerate(looks(6, 5.0)):
        draw(tmp_path / f"{k}.png", facing(ahead), np.stack([starts, ends], axis=1))
        views.append((f"{k}.png", camera(), facing(ahead)))
    shown = lines_of(tmp_path, views)
    assert wall_direction(shown, UP) is None
    assert vertical_from_lines(shown, UP) is None
    assert not len(lines_of(tmp_path, [("missing.png", camera(), facing(np.array([1.0, 0, 0])))]).weights)


def test_edges_in_one_direction_leave_a_tilt_open() -> None:
    around = np.radians([0.0, 30, 75, 120])
    normals = np.stack([np.cos(around), np.sin(around), np.zeros(4)], axis=1)
    edges = vertical_from_lines(Lines(normals, np.full(4, 0.4)), turned(3, (1, 0, 0)) @ UP)
    assert edges is not None and degrees(edges[0], UP) < 0.01
    assert vertical_from_lines(Lines(np.tile(normals[:1], (4, 1)), np.full(4, 0.4)), UP) is None
    assert vertical_from_lines(Lines(normals[:3], np.full(3, 0.4)), UP) is None
    assert vertical_from_lines(Lines(normals, np.full(4, 0.1)), UP) is None


def test_an_exact_vertical_is_kept() -> None:
    seen = walk(np.eye(3), table=True)
    found = camera_height(seen, np.ones(len(seen.numbers), bool), UP, is_exact=True)
    assert found is not None and found[0] == pytest.approx(HIGH, rel=0.005)
    assert found[1] == pytest.approx(UP)
