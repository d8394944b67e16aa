"""Strips, depth and views against closed forms, and against a sampler that is written from the simulator's table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scan_samples import small_model
from test_render_panorama import HERE, RADIUS, sphere
from test_skybox_faces import CONFIRMED

from nvsim.benchmarks.panorama import furnished_hall
from nvsim.evaluation.scan_files import direction_errors, direction_model, place_on_strip, sample_strip, seam_steps
from nvsim.geometry.directions import NAMES, skybox, sweep
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.r2r.observations.skybox import as_units, focal_of, skybox_of, strip_pixels
from nvsim.r2r.observations.surround import draw_surround
from nvsim.render.model import render_model
from nvsim.render.panorama import render_cube
from nvsim.splats.types import Gaussians, SubmapModel

SIDE = 64


def test_every_pixel_of_a_strip_looks_where_the_confirmed_table_says():
    model = direction_model()
    strip = skybox_of(draw_surround(model, HERE, focal_of(SIDE)), model.floor, SIDE)
    seen = 2 * strip.color.astype(float) / 255 - 1
    along = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    for face, name in enumerate(NAMES):
        camera = np.array([[CONFIRMED[name](u, r) for u in along] for r in along])
        world = np.stack([camera[..., 0], camera[..., 2], -camera[..., 1]], axis=-1)  # a level pose that faces +y
        world /= np.linalg.norm(world, axis=-1, keepdims=True)
        assert np.abs(seen[:, face * SIDE : (face + 1) * SIDE] - world).max() < 0.012, name  # 8 bits are 0.008


def test_faces_look_where_they_should_after_jpeg_and_back():
    for name, error in direction_errors(256, 95).items():
        assert error["turned"] < 0.05 and error["mean"] < 0.4, name


def test_the_two_ways_to_find_a_pixel_agree():
    ways = np.random.default_rng(2).normal(size=(5000, 3))
    face, right, down = place_on_strip(ways)
    row, column = strip_pixels(ways, 512)
    assert (column // 512 == face).all()
    assert np.abs((column % 512 + 0.5) / 256 - 1 - right).max() < 1 / 255
    assert np.abs((row + 0.5) / 256 - 1 - down).max() < 1 / 255


def test_depth_is_the_distance_along_the_ray():
    model = sphere()
    depth = skybox_of(draw_surround(model, HERE, focal_of(SIDE)), model.floor, SIDE).depth / 4000
    assert np.abs(depth - RADIUS).max() < 0.02 * RADIUS


def test_depth_meets_the_floor_where_there_are_no_gaussians():
    model = SubmapModel(Gaussians.empty(), None, None, FloorSurface.flat(0.0))
    eye = np.array([3.0, 1.0, 1.5])
    depth = skybox_of(draw_surround(model, eye, focal_of(SIDE)), model.floor, SIDE).depth.astype(int)
    along = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    u, r = np.meshgrid(along, along)
    assert np.abs(depth[:, 5 * SIDE :] - 4000 * 1.5 * np.sqrt(1 + u**2 + r**2)).max() <= 1
    assert (depth[:, :SIDE] == 0).all(), "nothing is above"
    front = depth[:, 3 * SIDE : 4 * SIDE]
    assert (front[: SIDE // 2] == 0).all() and (front[SIDE // 2 + 1] == 65535).all(), "far floor saturates"


def test_depth_units_end_at_16_bits():
    assert as_units(np.array([0.0, 0.00025, 1.0, 16.383, 1000.0], np.float32)).tolist() == [0, 1, 4000, 65532, 65535]


def test_faces_have_no_seams_where_those_of_a_cube_have():
    model, place = sphere(), HERE + 0.5
    over, beside = seam_steps(skybox_of(draw_surround(model, place, focal_of(128)), model.floor, 128).color)
    assert over < 1.05 * beside
    cube = skybox([view.rgb for view in render_cube(model, place, 128)])
    over, beside = seam_steps((255 * cube.clip(0, 1)).astype(np.uint8))
    assert over > 1.5 * beside


def test_steps_over_seams_are_found():
    strip = np.zeros((32, 192, 3), np.uint8)
    for face in range(6):
        strip[:, 32 * face : 32 * (face + 1)] = 20 * face
    over, beside = seam_steps(strip)
    assert beside == 0 and over == pytest.approx(20 * np.mean([abs(a - b) for a, b in NEIGHBORS]))


NEIGHBORS = [(a, b) for a in range(6) for b in range(a) if {a, b} not in ({0, 5}, {1, 3}, {2, 4})]
"""The twelve pairs of faces that share a border: all but the opposite ones."""


def test_views_of_the_sweep_are_in_the_order_of_view_indices():
    cameras = sweep(HERE)
    ahead = np.array([c.rotation[:, 2] for c in cameras])
    elevation = np.degrees(np.arcsin(ahead[:, 2]))
    np.testing.assert_allclose(elevation, np.repeat([-30, 0, 30], 12), atol=1e-9)
    np.testing.assert_allclose(ahead[15], [1, 0, 0], atol=1e-9)  # three steps to the right of +y
    k = cameras[0].intrinsics
    assert (k.width, k.height) == (640, 480) and 2 * math.atan(240 / k.fy) == pytest.approx(math.radians(60))


def test_views_are_near_those_drawn_directly():
    model, place = small_model(0.0), np.array([6.0, 3.0, 1.5])
    surround = draw_surround(model, place, focal_of(512))
    for camera in [sweep(place)[i] for i in (2, 13, 30)]:
        error = np.clip(surround.color(camera), 0, 1) - np.clip(render_model(model, camera).rgb, 0, 1)
        assert -10 * np.log10((error**2).mean()) > 37


def test_what_is_sampled_from_a_strip_is_what_the_surround_shows():
    model, places = furnished_hall()
    surround = draw_surround(model, places[0], focal_of(512))
    strip = skybox_of(surround, model.floor, 512).color
    camera = sweep(places[0])[16]
    error = sample_strip(strip, camera.rays()) / 255 - np.clip(surround.color(camera), 0, 1)
    assert -10 * np.log10((error**2).mean()) > 33
