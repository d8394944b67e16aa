"""Where Gaussians start, and Adam."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.training.config import TrainingConfig
from nvsim.training.initialize import gaussians_at, initial_gaussians, visible_points
from nvsim.training.optimizer import ParameterGroup
from nvsim.training.starting_points import detail_shares, flatten, guessed_points, triangulated_cloud
from nvsim.training.synthetic import ROOM, synthetic_room

FLOOR = FloorSurface.flat(0.0)


def test_points_behind_a_wall_and_near_the_floor_seed_nothing() -> None:
    camera = Camera(Intrinsics.from_fov(64, 48, 1.4), camera_pose(np.array([0.0, 0.0, 1.2]), 0.0))
    room = synthetic_room(2, 64, 48, 10)
    view = type(room.views[0])("a", camera, room.views[0].image, room.views[0].floor)
    across, up = np.meshgrid(np.linspace(-3, 3, 160), np.linspace(0.01, 2.5, 80))
    wall = np.stack([across.ravel(), np.full(across.size, 2.0), up.ravel()], axis=1)
    behind, back = wall + [0, 1.5, 0], wall * [1, -1, 1]
    cloud = Cloud(np.concatenate([wall, behind, back]).astype(np.float32))
    points, colors = visible_points([view], cloud)
    assert len(points) > 500
    assert (np.abs(points[:, 1] - 2.0) < 1e-5).all()
    assert colors.min() >= 0 and colors.max() <= 1
    seeds = initial_gaussians([view], cloud, FLOOR, TrainingConfig(), np.random.default_rng(0))
    assert seeds.means[:, 2].min() > 0.04


def test_without_a_cloud_seeds_lie_in_front_of_the_cameras() -> None:
    room = synthetic_room(6, 64, 48, 10)
    nothing = np.zeros((0, 3), np.float32)
    points, colors = guessed_points(room.views, nothing, room.floor, 400, np.random.default_rng(0))
    assert points.shape == colors.shape == (400, 3)
    seen = np.zeros(len(points), bool)
    for view in room.views:
        pixels, depth = view.camera.project(points)
        seen |= (depth > 0) & (pixels >= -0.01).all(axis=1) & (pixels <= [64.01, 48.01]).all(axis=1)
    assert seen.all()


def test_guessed_points_lie_near_the_walls_that_stand_on_the_floor() -> None:
    room = synthetic_room(12, 96, 72, 10)
    nothing = np.zeros((0, 3), np.float32)
    points, _ = guessed_points(room.views, nothing, room.floor, 2000, np.random.default_rng(0))
    to_wall = np.minimum(np.abs(points), np.abs(ROOM - points)).min(axis=1)
    assert np.median(to_wall) < 0.3


def test_triangulated_features_lie_on_the_walls() -> None:
    room = synthetic_room(40, 240, 180, 10)
    cloud = triangulated_cloud(room.views)
    assert cloud.kind == "sfm" and len(cloud.points) > 100
    assert cloud.colors is not None and len(cloud.colors) == len(cloud.points)
    off = np.minimum(np.abs(cloud.points), np.abs(ROOM - cloud.points)).min(axis=1)
    assert np.median(off) < 0.1


def test_a_scan_seeds_more_where_its_colors_vary() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 4, 8000), np.zeros(8000), rng.uniform(0, 2, 8000)]).astype(np.float32)
    colors = np.full((8000, 3), 0.5, np.float32)
    busy = points[:, 0] > 2
    colors[busy] = rng.random((int(busy.sum()), 3))
    shares = detail_shares(points, colors, 1.0)
    assert shares.sum() == pytest.approx(1)
    inside = np.abs(points[:, 0] - 2) > 0.2
    assert shares[busy & inside].mean() > 5 * shares[~busy & inside].mean()
    np.testing.assert_allclose(detail_shares(points, colors, 0.0), 1 / 8000)


def test_seeds_of_a_scan_lie_flat_on_its_surface() -> None:
    rng = np.random.default_rng(0)
    normal = np.array([0.6, 0.0, 0.8])
    across = np.array([0.8, 0.0, -0.6])
    on = rng.uniform(0, 2, (3000, 2))
    surface = on[:, :1] * across + on[:, 1:] * np.array([0, 1, 0]) + rng.normal(0, 0.002, (3000, 1)) * normal
    made = gaussians_at(surface[:200].astype(np.float32), np.full((200, 3), 0.5), 0)
    width = np.exp(made.log_scales[:, 1])
    flatten(made, surface.astype(np.float32), 0.3)
    axes = matrix_from_quaternion(made.quats)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-5)
    assert np.median(np.abs(axes[:, :, 0] @ normal)) > 0.99
    np.testing.assert_allclose(np.exp(made.log_scales), width[:, None] * [0.3, 1, 1], rtol=1e-4)


def test_adam_is_the_adam_of_torch_with_a_rate_per_column() -> None:
    rng = np.random.default_rng(0)
    start = rng.random((700, 4, 3)).astype(np.float32)
    group = ParameterGroup.of(start.copy(), np.array([1e-2] * 3 + [1e-3] * 9, np.float32))
    dc, rest = (torch.nn.Parameter(torch.from_numpy(a.copy())) for a in (start[:, :1], start[:, 1:]))
    reference = torch.optim.Adam([{"params": [dc], "lr": 1e-2}, {"params": [rest], "lr": 1e-3}], eps=1e-15)
    for step in range(1, 8):
        group.gradient[:] = 1e-3 * rng.normal(size=start.shape)
        dc.grad, rest.grad = (torch.from_numpy(g.copy()) for g in (group.gradient[:, :1], group.gradient[:, 1:]))
        group.step(step)
        reference.step()
    np.testing.assert_allclose(group.values[:, :1], dc.detach().numpy(), atol=1e-5)
    np.testing.assert_allclose(group.values[:, 1:], rest.detach().numpy(), atol=1e-5)
