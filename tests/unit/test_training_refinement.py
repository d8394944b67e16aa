"""Seeds, growth, pruning, the robust mask and Adam."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians
from nvsim.training.config import DensifyConfig, RobustConfig, TrainingConfig
from nvsim.training.densify import Densifier, divide
from nvsim.training.guess import guessed_points
from nvsim.training.initialise import gaussians_at, initial_gaussians, seen_points
from nvsim.training.optimizer import Group
from nvsim.training.robust import RobustMask
from nvsim.training.synthetic import ROOM, synthetic_room
from nvsim.training.triangulate import triangulated_cloud

FLOOR = FloorSurface.flat(0.0)


def some_gaussians(count: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    made = gaussians_at(rng.uniform(0.5, 3, (count, 3)).astype(np.float32), rng.random((count, 3)), 1)
    made.quats[:] = rng.normal(size=(count, 4))
    made.log_scales += rng.normal(0, 0.3, (count, 3)).astype(np.float32)
    return made


@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(1, 300),
    cap=st.integers(100, 320),
    growth=st.floats(0, 3),
    faint=st.floats(0, 1),
    seed=st.integers(0, 100),
)
def test_the_cap_is_never_exceeded(count: int, cap: int, growth: float, faint: float, seed: int) -> None:
    count = min(count, cap)
    rng = np.random.default_rng(seed)
    gaussians = some_gaussians(count, seed)
    gaussians.opacity_logits[rng.random(count) < faint] = -9
    config = TrainingConfig(steps=100, gaussian_cap=cap, densify=DensifyConfig(growth=growth))
    done = Densifier(config, FLOOR).refine(gaussians, rng.random(count).astype(np.float32), 50)
    assert done.count <= cap
    assert len(done.born.means) == 2 * len(done.divided)
    assert not set(done.kept) & set(done.divided)


def test_the_neediest_gaussians_are_divided() -> None:
    gaussians, gradient = some_gaussians(200), np.linspace(0, 1, 200).astype(np.float32)
    config = TrainingConfig(steps=100, gaussian_cap=1000, densify=DensifyConfig(growth=0.1))
    done = Densifier(config, FLOOR).refine(gaussians, gradient, 50)
    np.testing.assert_array_equal(done.divided, np.arange(180, 200))


def test_faint_vast_broken_and_sunk_gaussians_are_removed() -> None:
    gaussians = some_gaussians(50)
    gaussians.opacity_logits[3] = -6
    gaussians.log_scales[5, 1] = 2.0
    gaussians.means[7, 0] = np.nan
    gaussians.means[9, 2] = -0.2
    gaussians.opacity_logits[11] = np.nan
    lost = Densifier(TrainingConfig(), FLOOR).lost(gaussians)
    assert set(np.flatnonzero(lost)) == {3, 5, 7, 9, 11}


def test_two_halves_lie_on_the_longest_axis_and_let_through_what_one_did() -> None:
    gaussians = gaussians_at(np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 1.0]], np.float32), np.full((2, 3), 0.5), 0)
    gaussians.log_scales[:] = np.log([0.1, 0.4, 0.2])
    gaussians.opacity_logits[:] = 1.0
    halves = divide(gaussians, np.array([0]))
    np.testing.assert_allclose(halves.means, [[1.0, 1.8, 3.0], [1.0, 2.2, 3.0]], atol=1e-6)
    opacity = 1 / (1 + np.exp(-halves.opacity_logits))
    assert np.prod(1 - opacity) == pytest.approx(1 - 1 / (1 + np.exp(-1.0)), rel=1e-5)


def test_points_behind_a_wall_and_near_the_floor_seed_nothing() -> None:
    camera = Camera(Intrinsics.from_fov(64, 48, 1.4), look(np.array([0.0, 0.0, 1.2]), 0.0))
    room = synthetic_room(2, 64, 48, 10)
    view = type(room.views[0])("a", camera, room.views[0].image, room.views[0].floor)
    across, up = np.meshgrid(np.linspace(-3, 3, 160), np.linspace(0.01, 2.5, 80))
    wall = np.stack([across.ravel(), np.full(across.size, 2.0), up.ravel()], axis=1)
    behind, back = wall + [0, 1.5, 0], wall * [1, -1, 1]
    cloud = Cloud(np.concatenate([wall, behind, back]).astype(np.float32))
    points, colors = seen_points([view], cloud)
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


def test_robust_mask_rejects_a_pasted_square_and_nothing_else() -> None:
    rng = np.random.default_rng(0)
    mask = RobustMask(RobustConfig(), 3, 160, 120)
    for visit in range(4):
        error = rng.uniform(0, 0.06, (3, 120, 160) if visit % 2 else (3, 60, 80)).astype(np.float32)
        scale = error.shape[1] / 120
        error[:, int(40 * scale) : int(72 * scale), int(64 * scale) : int(96 * scale)] = 0.5
        mask.observe(1, error)
    inlier = np.ones((120, 160), bool)
    mask.inlier(1, inlier)
    assert not inlier[40:72, 64:96].any()
    assert (~inlier).sum() <= (32 + 16) * (32 + 16)  # one block more on each side
    mask.inlier(0, inlier)  # a view that was never visited
    assert inlier.all()


def test_robust_mask_keeps_a_pattern_that_is_still_blurred() -> None:
    mask = RobustMask(RobustConfig(), 1, 160, 120)
    error = np.zeros((3, 120, 160), np.float32)
    error[:, 40:72, 64:96] = np.where(np.indices((32, 32)).sum(axis=0) % 2, 0.5, -0.5)
    mask.observe(0, error)
    inlier = np.ones((120, 160), bool)
    mask.inlier(0, inlier)
    assert inlier.all()


def test_robust_mask_leaves_an_image_alone_that_is_wrong_all_over() -> None:
    mask = RobustMask(RobustConfig(), 1, 160, 120)
    mask.observe(0, np.random.default_rng(0).uniform(0.2, 0.6, (3, 120, 160)).astype(np.float32))
    inlier = np.ones((120, 160), bool)
    mask.inlier(0, inlier)
    assert inlier.all()


def test_adam_is_the_adam_of_torch_with_a_rate_per_column() -> None:
    rng = np.random.default_rng(0)
    start = rng.random((700, 4, 3)).astype(np.float32)
    group = Group.of(start.copy(), np.array([1e-2] * 3 + [1e-3] * 9, np.float32))
    dc, rest = (torch.nn.Parameter(torch.from_numpy(a.copy())) for a in (start[:, :1], start[:, 1:]))
    reference = torch.optim.Adam([{"params": [dc], "lr": 1e-2}, {"params": [rest], "lr": 1e-3}], eps=1e-15)
    for step in range(1, 8):
        group.gradient[:] = 1e-3 * rng.normal(size=start.shape)
        dc.grad, rest.grad = (torch.from_numpy(g.copy()) for g in (group.gradient[:, :1], group.gradient[:, 1:]))
        group.step(step)
        reference.step()
    np.testing.assert_allclose(group.values[:, :1], dc.detach().numpy(), atol=1e-5)
    np.testing.assert_allclose(group.values[:, 1:], rest.detach().numpy(), atol=1e-5)
