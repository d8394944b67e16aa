"""The semantic and the normal role by geometry, on a room whose truth is known."""

from __future__ import annotations

import math

import numpy as np

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.geometric_roles import CloudNormals, FloorSimilarity
from nvsim.perception.hybrid import HybridFloor
from nvsim.perception.regions import RegionGrowing

WALL = 4.0
DESK = ((-0.8, 1.8), (0.8, 2.6), 0.75)  # low corner, high corner, height
PATTERN = np.random.default_rng(0).random((200, 200))


def cloud() -> Cloud:
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(-6, 6, 60_000), rng.uniform(-3, WALL, 60_000), np.zeros(60_000)])
    (x0, y0), (x1, y1), top = DESK
    under = (floor[:, 0] > x0) & (floor[:, 0] < x1) & (floor[:, 1] > y0) & (floor[:, 1] < y1)
    wall = np.column_stack([rng.uniform(-6, 6, 40_000), np.full(40_000, WALL), rng.uniform(0, 4, 40_000)])
    desk = np.column_stack([rng.uniform(x0, x1, 4000), rng.uniform(y0, y1, 4000), np.full(4000, top)])
    front = np.column_stack([rng.uniform(x0, x1, 4000), np.full(4000, y0), rng.uniform(0, top, 4000)])
    return Cloud(np.concatenate([floor[~under], wall, desk, front]).astype(np.float32))


def view(x: float, y: float, tilt: float = -20) -> Camera:
    return Camera(
        Intrinsics.from_fov(320, 240, math.radians(75)), camera_pose(np.array([x, y, 1.5]), 0.0, math.radians(tilt))
    )


def cast(camera: Camera, desk_like_floor: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(H, W, 3) image, (H, W) 0 wall, 1 floor, 2 desk top, 3 desk front; (H, W, 3) normals; by ray and plane."""
    eye, rays = camera.position, camera.rays().astype(np.float64)
    best = np.full(rays.shape[:2], np.inf)
    kind, normals = np.zeros(rays.shape[:2], int), np.zeros(rays.shape)
    (x0, y0), (x1, y1), top = DESK
    with np.errstate(divide="ignore", invalid="ignore"):
        for number, axis, level, inside in (
            (0, 1, WALL, None), (1, 2, 0.0, None),
            (2, 2, top, lambda p: (p[..., 0] > x0) & (p[..., 0] < x1) & (p[..., 1] > y0) & (p[..., 1] < y1)),
            (3, 1, y0, lambda p: (p[..., 0] > x0) & (p[..., 0] < x1) & (p[..., 2] > 0) & (p[..., 2] < top)),
        ):  # fmt: skip
            distance = (level - eye[axis]) / rays[..., axis]
            hit = (distance > 0) & (distance < best)
            if inside is not None:
                hit &= inside(eye + distance[..., None] * rays)
            best[hit], kind[hit] = distance[hit], number
            normals[hit] = np.eye(3)[axis] * -np.sign(rays[..., axis])[hit][:, None]
    place = eye + best[..., None] * rays
    index = np.clip(((place[..., :2] + 4) * 20).astype(int), 0, 199)
    floor = 100 + 60 * PATTERN[index[..., 1], index[..., 0]]
    shade = np.choose(
        kind,
        [
            np.full_like(floor, 220),
            floor,
            floor if desk_like_floor else np.full_like(floor, 40),
            np.full_like(floor, 60),
        ],
    )
    return np.repeat(shade[..., None], 3, axis=-1).astype(np.uint8), kind, normals


def learnt() -> GeometricFloor:
    floor = GeometricFloor(cloud(), FloorSurface.flat(0.0))
    cameras = [view(x, y) for y in (-2.5, -1.5, -0.5, 0.5) for x in (-1.2, 0.0, 1.2)]
    floor.learn(cameras, lambda i: cast(cameras[i])[0])
    return floor


def test_normals_of_the_cloud_are_those_of_the_surfaces_and_face_the_camera() -> None:
    camera = view(0.2, -1.0)
    image, kind, truth = cast(camera)
    found = CloudNormals(learnt(), cloud()).normals(image, camera)
    for surface in range(4):
        region = kind == surface
        angle = np.degrees(np.arccos(np.clip(np.sum(found * truth, axis=-1)[region], -1, 1)))
        assert np.median(angle) < 4, surface
        assert np.mean(angle < 20) > 0.85, surface
    length = np.linalg.norm(found, axis=-1)
    assert np.all((length < 1e-6) | (np.abs(length - 1) < 1e-4))


def test_what_looks_like_the_known_floor_is_told_from_what_does_not() -> None:
    camera = view(0.2, -1.0)
    image, kind, _ = cast(camera)
    probability = FloorSimilarity(learnt()).floor_probability(image, camera)
    assert probability.shape == kind.shape and probability.min() >= 0 and probability.max() <= 1
    near = kind == 1
    assert np.mean(probability[near] >= 0.5) > 0.8
    assert np.mean(probability[kind == 3] >= 0.5) < 0.1
    assert not (probability[camera.rays()[..., 2] > 0] > 0).any()  # nobody sees floor above the horizon


def test_a_desk_of_the_floors_own_wood_is_not_taken_for_floor() -> None:
    camera = view(0.2, -1.0)
    image, kind, _ = cast(camera, desk_like_floor=True)
    probability = FloorSimilarity(learnt()).floor_probability(image, camera)
    assert np.mean(probability[kind == 2] >= 0.5) < 0.1


def test_the_hybrid_of_geometric_roles_finds_the_floor_and_not_the_desk() -> None:
    camera = view(0.2, -1.0)
    image, kind, _ = cast(camera)
    floor = learnt()
    steps = HybridFloor(FloorSimilarity(floor), CloudNormals(floor, cloud()), RegionGrowing()).steps(camera, image)
    assert steps.horizontal[kind == 2].mean() > 0.8  # flat, but not floor
    truth = kind == 1
    assert (steps.prompted & truth).sum() / (steps.prompted | truth).sum() > 0.93
    assert len(steps.points) == 3 and truth[steps.points[:, 1].astype(int), steps.points[:, 0].astype(int)].all()
