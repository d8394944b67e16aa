"""The background kernel against the classes that define it, in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from painted_background import render_background

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import cube
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_gaussians, render_model
from nvsim.splats.harmonics import basis
from nvsim.splats.types import Background, FloorTexture, Gaussians, SubmapModel

CAMERA = Camera(Intrinsics(57, 43, 40.0, 44.0, 25.0, 20.0), camera_pose(np.array([2.0, 1.5, 1.4]), 0.6, -0.5))


def network(seed=0):
    r = np.random.default_rng(seed)
    weights = {}
    for name, out, inputs in (
        ("embed.0", 32, 27),
        ("embed.1", 12, 32),
        ("trunk.0", 20, 12),
        ("trunk.1", 20, 20),
        ("base", 3, 20),
        ("rest", 72, 20),
    ):
        weights[f"{name}.weight"] = (r.normal(size=(out, inputs)) / np.sqrt(inputs)).astype(np.float32)
        weights[f"{name}.bias"] = r.normal(0, 0.1, out).astype(np.float32)
    return Background(weights)


def texture(seed=1):
    r = np.random.default_rng(seed)
    levels = tuple(r.normal(0, 0.3, (rows, columns, 3)).astype(np.float32) for rows, columns in ((5, 7), (21, 26)))
    return FloorTexture(levels, (0.5, 0.2), (6.0, 4.9))


FLOORS = {
    "flat": FloorSurface.flat(0.1),
    "uneven": FloorSurface(np.random.default_rng(2).normal(0, 0.05, (5, 6)).astype(np.float32), (0.2, 0.4), 1.1),
}


def sampled(level, low, high, xy):
    """Bilinear at texel centers, border values outside."""
    rows, columns = level.shape[:2]
    c = np.clip((xy[..., 0] - low[0]) / (high[0] - low[0]) * columns - 0.5, 0, columns - 1)
    r = np.clip((xy[..., 1] - low[1]) / (high[1] - low[1]) * rows - 0.5, 0, rows - 1)
    c0, r0 = np.minimum(c.astype(int), max(columns - 2, 0)), np.minimum(r.astype(int), max(rows - 2, 0))
    fc, fr = (c - c0)[..., None], (r - r0)[..., None]
    top = level[r0, c0] * (1 - fc) + level[r0, c0 + 1] * fc
    return top * (1 - fr) + (level[r0 + 1, c0] * (1 - fc) + level[r0 + 1, c0 + 1] * fc) * fr


def plain(model, camera):
    rays = camera.rays().astype(np.float64)
    image = np.einsum("hwk,kc->hwc", basis(rays, 4), model.background.coefficients(camera.position))
    if model.texture is None:
        return image
    t = model.texture
    distance = model.floor.distance_along_rays(camera.position, rays).astype(np.float64)
    hit = np.isfinite(distance)
    distance = np.where(hit, distance, 0)
    xy = camera.position[:2] + distance[..., None] * rays[..., :2]
    forward = rays @ camera.rotation[:, 2]
    footprint = distance * forward / camera.intrinsics.fx / np.sqrt(np.where(hit, -rays[..., 2], 1))
    for level in t.levels:
        texel = max((t.high[0] - t.low[0]) / level.shape[1], (t.high[1] - t.low[1]) / level.shape[0])
        weight = np.clip(1.5 - 0.5 * footprint / texel, 0, 1) * hit
        image += weight[..., None] * sampled(level, t.low, t.high, xy)
    return image


@pytest.mark.parametrize("floor", FLOORS)
def test_background_is_sh_of_the_ray_plus_texture_where_it_meets_the_floor(floor):
    model = SubmapModel(Gaussians.empty(), network(), texture(), FLOORS[floor])
    image = render_background(model, CAMERA)
    expected = plain(model, CAMERA)
    assert np.abs(expected - plain(SubmapModel(Gaussians.empty(), network(), None, FLOORS[floor]), CAMERA)).max() > 0.1
    np.testing.assert_allclose(image, expected, atol=2e-3)


def test_far_floor_fades_to_the_mean_of_its_texture_instead_of_aliasing():
    checks = np.indices((400, 400)).sum(0) % 2 * 2.0 - 1
    fine = FloorTexture((np.repeat(checks[..., None], 3, 2).astype(np.float32),), (-10.0, -10.0), (10.0, 10.0))
    model = SubmapModel(Gaussians.empty(), None, fine, FloorSurface.flat(0))
    camera = Camera(Intrinsics.from_fov(96, 64, 1.2), camera_pose(np.array([0.0, -9.0, 1.5]), 0.0))
    image = render_background(model, camera)
    distance = model.floor.distance_along_rays(camera.position, camera.rays())
    far = np.isfinite(distance) & (distance > 9)
    assert far.any()
    assert np.abs(image[far]).max() < 1e-6


def test_a_model_without_background_is_black_behind_its_gaussians():
    model = SubmapModel(Gaussians.empty(), None, None, FloorSurface.flat(0))
    assert not render_background(model, CAMERA).any()
    assert not render_model(model, CAMERA).rgb.any()


def test_a_model_is_its_gaussians_and_the_background_that_they_let_through():
    r = np.random.default_rng(3)
    n = 60
    local = r.uniform([-1, -1, 1], [1, 1, 4], (n, 3))
    f = np.float32
    gaussians = Gaussians(
        (local @ CAMERA.rotation.T + CAMERA.position).astype(f),
        r.normal(-2, 0.4, (n, 3)).astype(f),
        r.normal(size=(n, 4)).astype(f),
        r.normal(0, 1, n).astype(f),
        r.normal(0, 0.3, (n, 4, 3)).astype(f),
    )
    model = SubmapModel(gaussians, network(), texture(), FLOORS["flat"])
    whole = render_model(model, CAMERA)
    alone = render_gaussians(gaussians, CAMERA)
    expected = alone.rgb + (1 - alone.alpha[..., None]) * render_background(model, CAMERA)
    np.testing.assert_allclose(whole.rgb, expected, atol=3e-3)
    np.testing.assert_array_equal(whole.alpha, alone.alpha)


def test_every_direction_is_seen_by_exactly_one_face_of_the_cube():
    directions = np.random.default_rng(4).normal(size=(500, 3))
    seen = np.zeros(500, int)
    for camera in cube(np.zeros(3), 64, offset=0.3):
        pixels, depth = camera.project(directions)
        seen += (depth > 0) & (pixels > 0).all(1) & (pixels < 64).all(1)
    assert (seen == 1).all()
