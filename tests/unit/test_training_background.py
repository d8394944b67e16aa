"""The background network, its pixels and the floor texture against the contract, numpy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.floor_rays import meet_floor, pack_floor
from nvsim.render.sky import evaluate, evaluate_gradient, pack_camera
from nvsim.splats.harmonics import basis
from nvsim.training.config import AppearanceConfig, TrainingConfig
from nvsim.training.floor_paint import LearnedTexture, initial_floor_paint
from nvsim.training.networks import BackgroundNetwork, PositionEmbedding
from nvsim.training.synthetic import synthetic_room

CAMERA = Camera(Intrinsics(40, 30, 31.0, 33.0, 19.0, 16.0), camera_pose(np.array([1.2, 0.7, 1.4]), 0.8, -0.5))


LOOK = AppearanceConfig()


def network() -> BackgroundNetwork:
    made = BackgroundNetwork(LOOK, 5, np.array([0.6, 0.5, 0.4]))
    made.values[:] += 0.05 * np.random.default_rng(2).standard_normal(made.values.shape).astype(np.float32)
    return made


def hits_of(camera: Camera, floor: FloorSurface) -> np.ndarray:
    k = camera.intrinsics
    hits = np.empty((3, k.height, k.width), np.float32)
    everywhere = np.ones((k.height, k.width), np.float32)
    meet_floor(pack_camera(camera), *pack_floor(floor), everywhere < 0, everywhere, hits)
    return hits


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (3.0, -7.5, 1.3), (40.0, 25.0, 2.0)])
def test_network_equals_its_export(position: tuple[float, float, float]) -> None:
    made, embedding = network(), PositionEmbedding(LOOK, 3)
    ours = made.coefficients(embedding.embedding_at(np.array(position), None)).detach().numpy()
    exported = made.exported(embedding.exported())
    np.testing.assert_allclose(ours, exported.coefficients(np.array(position)), atol=1e-5)


@pytest.mark.parametrize("degree", [0, 2])
def test_degrees_that_have_not_joined_yet_are_zero_and_get_no_gradient(degree: int) -> None:
    made, used = network(), (degree + 1) ** 2
    coefficients = made.coefficients(torch.ones(LOOK.size), degree)
    assert coefficients[:used].abs().min() > 0
    assert not coefficients[used:].detach().numpy().any()
    coefficients.backward(torch.ones_like(coefficients))
    rest = made.gradient[-(72 * 129) :][: 72 * 128].reshape(24, 3, 128)
    assert rest[: used - 1].any(axis=2).all()
    assert not rest[used - 1 :].any()


def test_network_starts_near_the_given_color_in_every_direction() -> None:
    made = BackgroundNetwork(LOOK, 0, np.array([0.7, 0.5, 0.2]))
    coefficients = made.coefficients(torch.zeros(LOOK.size)).detach().numpy()
    assert not coefficients[1:].any()
    np.testing.assert_allclose(coefficients[0] * 0.2820948, [0.7, 0.5, 0.2], atol=0.1)


def test_pixels_are_the_harmonics_along_their_rays() -> None:
    coefficients = np.random.default_rng(0).normal(size=(25, 3)).astype(np.float32)
    out = np.empty((3, 30, 40), np.float32)
    evaluate(CAMERA, coefficients, out)
    np.testing.assert_allclose(out.transpose(1, 2, 0), basis(CAMERA.rays(), 4) @ coefficients, atol=2e-5)


def test_coefficient_gradient_is_the_adjoint_of_the_pixels() -> None:
    gradient = np.random.default_rng(1).normal(size=(3, 30, 40)).astype(np.float32)
    found = evaluate_gradient(CAMERA, gradient, np.empty((30, 9, 3), np.float32))
    expected = np.einsum("hwk,chw->kc", basis(CAMERA.rays(), 4), gradient)
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("curved", [False, True])
def test_hits_lie_where_the_floor_surface_is_met(curved: bool) -> None:
    floor = FloorSurface.flat(0.2)
    if curved:
        heights = np.random.default_rng(4).uniform(0, 0.1, (9, 8)).astype(np.float32)
        floor = FloorSurface(heights, (-1.0, -2.0), 1.0)
    hits, rays = hits_of(CAMERA, floor), CAMERA.rays()
    distance = floor.distance_along_rays(CAMERA.position, rays)
    met = np.isfinite(distance)
    np.testing.assert_array_equal(hits[2] > 0, met)
    expected = CAMERA.position[:2] + distance[met, None] * rays[met][:, :2]
    np.testing.assert_allclose(hits[:2, met].T, expected, atol=2e-3)


def test_texture_gradient_matches_finite_differences() -> None:
    rng = np.random.default_rng(6)
    texture = LearnedTexture((-0.5, 0.0), (3.0, 2.5))
    texture.values[:] = rng.normal(size=texture.values.shape)
    hits = hits_of(CAMERA, FloorSurface.flat(0.0))
    weights = rng.normal(size=(3, 30, 40)).astype(np.float32)

    def value() -> float:
        painted = np.zeros((3, 30, 40), np.float32)
        texture.add(hits, painted)
        return float((painted.astype(np.float64) * weights).sum())

    texture.collect(hits, np.ones((30, 40), bool), weights)
    gradient = texture.gradient.copy()
    touched = np.flatnonzero(np.abs(gradient).sum(axis=1) > 1e-2)
    assert {int(np.searchsorted(texture.table[:, 0], t, side="right")) for t in touched} == {1, 2, 3}
    for texel in rng.choice(touched, 25, replace=False):
        before = texture.values[texel, 1]
        texture.values[texel, 1] = before + 0.5
        above = value()
        texture.values[texel, 1] = before - 0.5
        assert above - value() == pytest.approx(gradient[texel, 1], abs=2e-3)
        texture.values[texel, 1] = before


def test_texture_outside_its_area_continues_its_border() -> None:
    texture = LearnedTexture((0.0, 0.0), (1.0, 1.0))
    texture.values[:] = 0
    texture.values[texture.level(2)] = 0.25
    hits = np.array([[[5.0, -3.0]], [[0.5, -2.0]], [[0.001, -1.0]]], np.float32)
    painted = np.zeros((3, 1, 2), np.float32)
    texture.add(hits, painted)
    np.testing.assert_allclose(painted[:, 0, 0], 0.25, rtol=1e-6)
    np.testing.assert_array_equal(painted[:, 0, 1], 0)  # this ray does not meet the floor


def test_first_paint_already_shows_the_floor() -> None:
    room = synthetic_room(12, 96, 72, 500)
    made, texture = initial_floor_paint(room.views, room.floor, TrainingConfig(), seed=0)
    assert made is not None and texture is not None
    view = room.views[3]
    painted = np.empty((3, 72, 96), np.float32)
    made.select_embedding(view.camera.position, view.name)
    evaluate(view.camera, made.background_coefficients(1.0), painted)
    constant = np.abs(painted.transpose(1, 2, 0) - view.image / 255.0)[view.floor].mean()
    texture.add(hits_of(view.camera, room.floor), painted)
    textured = np.abs(painted.transpose(1, 2, 0) - view.image / 255.0)[view.floor].mean()
    assert textured < 0.5 * constant
