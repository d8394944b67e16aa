"""Colours by embedding: their gradients against torch's tape and finite differences, their export against training."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.render.model import render_model
from nvsim.render.sky import pack_camera
from nvsim.render.workspace import NO_TINT, RenderBuffers
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians
from nvsim.training import trainer
from nvsim.training.appearance import LinearColors, NetworkColors, mark_in_view
from nvsim.training.config import AppearanceConfig, TrainingConfig
from nvsim.training.initialize import gaussians_at
from nvsim.training.networks import IndexEmbedding, Networks, PositionEmbedding
from nvsim.training.synthetic import SyntheticRoom, synthetic_room

CAMERA = Camera(Intrinsics(40, 30, 31.0, 33.0, 19.0, 16.0), camera_pose(np.array([1.2, 0.7, 1.4]), 0.8, -0.5))
LINEAR = AppearanceConfig()
NETWORK = AppearanceConfig(kind="network", features=6, layers=3, width=16)


def some_gaussians(count: int = 300) -> Gaussians:
    rng = np.random.default_rng(0)
    return gaussians_at(rng.uniform(-2, 5, (count, 3)).astype(np.float32), rng.random((count, 3)), 1)


def inputs(config: AppearanceConfig, count: int) -> tuple[np.ndarray, torch.Tensor, np.ndarray]:
    rng = np.random.default_rng(1)
    features = rng.normal(size=(count, config.features)).astype(np.float32)
    slopes = rng.normal(size=(count, 4, 3)).astype(np.float32)
    return features, torch.from_numpy(rng.normal(size=config.size).astype(np.float32)).requires_grad_(), slopes


def test_linear_gradients_are_those_of_the_tape_in_double_precision() -> None:
    g, colors = some_gaussians(), LinearColors(LINEAR, 0)
    colors.values[:] += 0.1 * np.random.default_rng(3).standard_normal(colors.values.shape).astype(np.float32)
    features, embedding, _ = inputs(LINEAR, len(g))
    shown, tint = colors.shown(g, features, embedding, CAMERA)
    assert shown is g
    workspace, k = RenderBuffers(), CAMERA.intrinsics
    workspace.project(g, CAMERA, True, tint=tint)
    workspace.bin()
    _, transmittance, _, _ = workspace.draw(k.height, k.width, False)
    rng, nothing = np.random.default_rng(7), np.zeros((k.height, k.width), np.float32)
    workspace.draw_gradient(transmittance, rng.normal(size=(*nothing.shape, 3)).astype(np.float32), nothing, nothing)
    d = replace(g, **{f.name: np.full_like(getattr(g, f.name), 9) for f in fields(g)})
    d_features = np.full_like(features, 7)
    d_matrix = workspace.project_gradient(g, d, np.empty((0, 3), np.float32), tint, d_features)
    colors.collect(d.sh, d_matrix, d_features)
    assert 20 < np.count_nonzero(d.sh[:, 0].any(axis=1)) < len(g)

    double = [torch.tensor(a, dtype=torch.float64, requires_grad=True) for a in (features, embedding.tolist())]
    weights = torch.tensor(colors.values[:, 0], dtype=torch.float64, requires_grad=True)
    matrix, bias = weights[: -3 * LINEAR.features].view(-1, LINEAR.size), weights[-3 * LINEAR.features :]
    w = (matrix @ double[1] + bias).view(3, -1)
    offset = double[0] @ w.T
    np.testing.assert_allclose(tint[0] @ tint[1].T, offset.detach().numpy(), atol=1e-5)
    (offset * torch.from_numpy(d.sh[:, 0]).double()).sum().backward()
    for ours, expected in (
        (d_features, double[0].grad),
        (embedding.grad, double[1].grad),
        (colors.gradient[:, 0], weights.grad),
    ):
        np.testing.assert_allclose(ours, expected, atol=1e-5 * float(expected.abs().max()))


def test_the_linear_form_starts_without_an_offset_and_with_the_colors_as_features() -> None:
    g, colors = some_gaussians(), LinearColors(LINEAR, 0)
    features = colors.first_features(g)
    np.testing.assert_allclose(features[:, :3] * DC, g.sh[:, 0] * DC + 0.5, atol=1e-6)
    tint = colors.shown(g, features, torch.ones(LINEAR.size), CAMERA)[1]
    np.testing.assert_array_equal(tint[0] @ tint[1].T, 0)


def test_a_tint_is_an_offset_of_the_first_coefficient() -> None:
    g, rng = some_gaussians(), np.random.default_rng(5)
    tint = rng.normal(size=(len(g), 4)).astype(np.float32), rng.normal(size=(3, 4)).astype(np.float32)
    offset = replace(g, sh=g.sh.copy())
    offset.sh[:, 0] += tint[0] @ tint[1].T
    pictures = []
    for gaussians, given in ((g, tint), (offset, NO_TINT)):
        workspace = RenderBuffers()
        workspace.project(gaussians, CAMERA, True, tint=given)
        workspace.bin()
        k = CAMERA.intrinsics
        pictures.append(workspace.draw(k.height, k.width, False)[0])
    assert pictures[0].max() > 0.1
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-5)


def test_network_gradients_are_finite_differences_and_only_of_what_is_in_view() -> None:
    g, colors = some_gaussians(), NetworkColors(NETWORK, 0, 4)
    colors.values[:] += 0.1 * np.random.default_rng(3).standard_normal(colors.values.shape).astype(np.float32)
    features, embedding, slopes = inputs(NETWORK, len(g))
    d_features = np.empty_like(features)
    colors.shown(g, features, embedding, CAMERA)
    colors.collect(slopes, NO_TINT[1], d_features)
    seen = np.flatnonzero(d_features.any(axis=1))
    assert 20 < len(seen) < len(g)

    def value() -> float:
        shown, _ = colors.shown(g, features, embedding.detach(), CAMERA)
        return float((shown.sh[seen].astype(np.float64) * slopes[seen]).sum())

    def difference(array: np.ndarray, at: tuple[int, ...]) -> float:
        before, h = array[at], np.float32(1e-2)
        array[at] = before + h
        above = value()
        array[at] = before - h
        below = value()
        array[at] = before
        return (above - below) / (2 * h)

    rng = np.random.default_rng(5)
    for row in rng.choice(seen, 10):
        assert difference(features, (row, 2)) == pytest.approx(d_features[row, 2], rel=0.05, abs=0.02)
    errors = []
    for weight in rng.choice(len(colors.values), 40, replace=False):
        errors.append(difference(colors.values, (weight, 0)) - colors.gradient[weight, 0])
    assert np.median(np.abs(errors)) < 0.01 * np.abs(colors.gradient).max()  # some cross the kink of a ReLU
    moved = embedding.detach().numpy()
    for i in range(0, NETWORK.size, 5):
        assert difference(moved, (i,)) == pytest.approx(float(embedding.grad[i]), rel=0.1, abs=0.5)


def test_every_gaussian_that_is_drawn_counts_as_in_view() -> None:
    rng = np.random.default_rng(8)
    g = some_gaussians(4000)
    g.log_scales[:] = rng.normal(-2.5, 1.0, g.log_scales.shape)
    workspace = RenderBuffers()
    workspace.project(g, CAMERA, True)
    seen = np.empty(len(g), np.bool_)
    mark_in_view(g.means, g.log_scales, pack_camera(CAMERA), np.array([40, 30], np.float32), seen)
    rows, counts = workspace.splats
    blocks, n = len(counts), len(g)
    drawn = np.concatenate([workspace._ids[n * b // blocks :][: counts[b]] for b in range(blocks)])
    assert len(rows) == n
    assert len(drawn) > 200
    assert seen[drawn].all()
    assert seen.sum() < 0.9 * n


@pytest.fixture(scope="module")
def room() -> SyntheticRoom:
    return synthetic_room(8, 96, 72, 3000)


def test_an_index_embedding_learns_the_row_of_the_view_and_no_other(room: SyntheticRoom) -> None:
    made = IndexEmbedding(AppearanceConfig(), room.views, 0, shared=False)
    made.embedding_at(room.views[3].camera.position, room.views[3].name).sum().backward()
    np.testing.assert_array_equal(np.flatnonzero(made.gradient.any(axis=1)), [3])
    mean = made.exported().at(np.zeros(3))
    np.testing.assert_allclose(mean, made.values.mean(axis=0), rtol=1e-5)


def test_views_held_out_of_training_leave_no_trace_in_an_index_embedding(room: SyntheticRoom) -> None:
    config = TrainingConfig(appearance=replace(LINEAR, embedding="index"))
    networks = Networks(room.views[:5], config, 0, np.full(3, 0.5))
    assert networks.embedding.values.shape == (5, 24)
    held_out = room.views[6]
    with pytest.raises(KeyError):
        networks.select_embedding(held_out.camera.position, held_out.name)
    networks.select_embedding(held_out.camera.position)
    np.testing.assert_allclose(networks.seen.detach(), networks.embedding.values.mean(axis=0), rtol=1e-5)


def test_without_an_embedding_the_background_is_the_same_everywhere(room: SyntheticRoom) -> None:
    networks = Networks(
        room.views, TrainingConfig(appearance=AppearanceConfig("none", kind="none")), 0, np.full(3, 0.5)
    )
    background = networks.exported_background()
    assert background is not None
    np.testing.assert_array_equal(background.coefficients(np.zeros(3)), background.coefficients(np.ones(3)))
    with pytest.raises(InputError, match="needs an embedding"):
        TrainingConfig(appearance=AppearanceConfig(embedding="none", kind="linear"))


def test_position_gradients_reach_the_network(room: SyntheticRoom) -> None:
    made = PositionEmbedding(AppearanceConfig(), 0)
    made.embedding_at(np.array([1.0, 2.0, 3.0]), None).sum().backward()
    assert made.gradient.any()


@pytest.mark.parametrize("embedding", ["position", "index"])
@pytest.mark.parametrize("kind", ["linear", "network"])
def test_what_was_trained_is_what_is_drawn(room: SyntheticRoom, kind: str, embedding: str) -> None:
    appearance = AppearanceConfig(embedding, kind=kind)
    config = TrainingConfig(steps=40, gaussian_cap=2500, appearance=appearance, sh_interval=0.1)
    config = replace(config, densify=replace(config.densify, every=10, start=0.0))
    run = trainer._TrainingRun(room.views, room.cloud, room.floor, config, 0, 0, lambda event: None)
    model = run.finish(None)
    assert model.appearance is not None
    assert len(model.appearance.features) == len(model.gaussians)
    assert model.appearance.features.any()
    if kind == "network":
        model.appearance.cell = 0.0
    for view in room.views[:3]:
        ours, _ = run.fit.composite(view.camera)
        drawn = render_model(model, view.camera).rgb
        np.testing.assert_allclose(drawn, ours, atol=1e-3)
