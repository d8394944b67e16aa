"""A synthetic room with patterned walls, rendered by exact ray-box intersection: views, point cloud, and floor in
memory, made in a moment. Benchmarks and tests use it if they have no capture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians
from nvsim.training.views import TrainingView

ROOM = np.array([6.0, 4.5, 2.6])
"""Extent of the room in meters; one lower corner is the origin."""
EYE_HEIGHT = 1.2
FIELD_OF_VIEW = np.radians(80)
_EDGE = 1e-3


@dataclass(frozen=True, eq=False)
class SyntheticRoom:
    """Training inputs made from the synthetic room."""

    views: list[TrainingView]
    cloud: Cloud
    floor: FloorSurface


def synthetic_room(views: int, width: int, height: int, points: int) -> SyntheticRoom:
    """`views` images of `width` x `height` pixels, along a trajectory around the room, and `points` of its walls,
    ceiling, and floor."""
    rng = np.random.default_rng(0)
    intrinsics = Intrinsics.from_fov(width, height, FIELD_OF_VIEW)
    taken = []
    for i, angle in enumerate(np.linspace(0, 2 * np.pi, views, endpoint=False)):
        place = ROOM[:2] * (0.5 + 0.2 * np.array([np.cos(angle), np.sin(angle)]))
        heading = 3 * angle + rng.uniform(-0.2, 0.2)
        camera = Camera(intrinsics, camera_pose(np.array([*place, EYE_HEIGHT]), heading, -0.1))
        taken.append(photograph(f"{i:04d}", camera))
    surface = _random_sides(rng, points)[0]
    colors = (255 * paint(surface)).astype(np.uint8)
    return SyntheticRoom(taken, Cloud(surface.astype(np.float32), colors), FloorSurface.flat(0.0))


def paint(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., 3) colors, 0 to 1, of places (..., 3), meters, on the room's surface: bands and tiles about 0.4 m wide."""
    x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    tiles = np.sign(np.sin(8 * x + 0.3) * np.sin(8 * y + 0.7) * np.cos(6 * z))
    slow = np.stack([np.sin(0.9 * x + z), np.sin(1.1 * y + 2), np.cos(0.8 * x - y)], axis=-1)
    return 0.5 + 0.12 * tiles[..., None] + 0.25 * slow


def photograph(name: str, camera: Camera) -> TrainingView:
    """The view of the room from `camera`, which is inside."""
    rays, eye = camera.rays().astype(np.float64), camera.position
    with np.errstate(divide="ignore"):
        exits = np.where(rays > 0, (ROOM - eye) / rays, -eye / rays)
    distance = exits.min(axis=-1)
    place = eye + distance[..., None] * rays
    image = np.clip(np.round(255 * paint(place)), 0, 255).astype(np.uint8)
    return TrainingView(name, camera, image, place[..., 2] < _EDGE)


def synthetic_gaussians(count: int, sh_degree: int, seed: int = 0) -> Gaussians:
    """Exactly `count` Gaussians flat on the room's surface, 3 % of them floating inside it, in random order. Their size
    in pixels, their number per pixel, and their opacity are those of a trained room, so that the rendering time is
    representative."""
    rng = np.random.default_rng(seed)
    means, axis = _random_sides(rng, count)
    adrift = rng.random(count) < 0.03
    means[adrift] = rng.random((int(adrift.sum()), 3)) * ROOM
    # The local z axis, along which they are flat, becomes the side's normal after a random turn about itself.
    turn, half = rng.uniform(0, np.pi, count), np.sqrt(0.5)
    c, s, none = np.cos(turn), np.sin(turn), np.zeros(count)
    quats = np.choose(axis[:, None], [half * np.stack(q, axis=1) for q in ((c, -s, c, s), (c, -c, s, s))] + [
        np.stack([c, none, none, s], axis=1)
    ])  # fmt: skip
    scales = np.exp(rng.normal(np.log(0.027 * np.sqrt(100_000 / count)), 0.4, (count, 3))) * [1, 1, 0.25]
    opacity = np.where(rng.random(count) < 0.85, rng.uniform(0.3, 0.99, count), rng.uniform(0.02, 0.3, count))
    sh = rng.normal(0, 0.05, (count, (sh_degree + 1) ** 2, 3))
    sh[:, 0] = (paint(means) - 0.5) / DC
    parts = (means, np.log(scales), quats, np.log(opacity / (1 - opacity)), sh)
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in parts))


def _random_sides(rng: np.random.Generator, count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    # Points on the box, and the axis of each one's side; the number of points of a side is proportional to its area.
    pairs = np.array([ROOM[1] * ROOM[2], ROOM[0] * ROOM[2], ROOM[0] * ROOM[1]])
    axis = rng.choice(3, count, p=pairs / pairs.sum())
    points = rng.random((count, 3)) * ROOM
    points[np.arange(count), axis] = np.where(rng.random(count) < 0.5, 0.0, ROOM[axis])
    return points, axis
