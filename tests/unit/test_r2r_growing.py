"""Views from as much of a surround as they need, against the whole; views put together from straight patches."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from nvsim.benchmarks.map_builder import hall
from nvsim.evaluation.scan import straight_view
from nvsim.evaluation.scan_files import direction_model
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.r2r.observations.incremental_surround import GrowingSurround, PlacesSeen
from nvsim.r2r.observations.surround import draw_surround
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel

HERE, FOCAL = np.array([1.5, 1.5, 1.3]), 96
VIEW = Intrinsics(120, 90, 78.0, 78.0, 60.0, 45.0)


@pytest.fixture(scope="module")
def model() -> SubmapModel:
    """The hall with Gaussians of all colors."""
    made = hall()
    colors = np.random.default_rng(0).uniform(-1, 1, made.gaussians.sh.shape).astype(np.float32)
    return replace(made, gaussians=replace(made.gaussians, sh=colors))


def looking(heading: float, elevation: float, k: Intrinsics = VIEW) -> Camera:
    return Camera(k, camera_pose(HERE, heading, elevation))


@pytest.mark.parametrize("fov", [40, 75, 120])
def test_a_view_is_that_of_the_whole_surround(model: SubmapModel, fov: float) -> None:
    whole = draw_surround(model, HERE, FOCAL)
    k = Intrinsics.from_fov(120, 90, math.radians(fov))
    random = np.random.default_rng(int(fov))
    for _ in range(6):
        camera = looking(random.uniform(0, 6.3), random.uniform(-1.5, 1.5), k)
        growing = GrowingSurround(HERE, FOCAL, True)
        growing._colors[:], growing._solids[:] = 77, 1e6  # what was not drawn must not be seen
        color, solid = growing.image(model, camera)
        expected, solids = whole.color_and_solid(camera)
        assert np.abs(color - 255 * np.clip(expected, 0, 1)).max() < 1.01
        np.testing.assert_allclose(solid, solids, atol=2e-2)
        assert np.abs(solid - solids).mean() < 1e-4


def test_turning_on_the_spot_draws_only_what_comes_into_view(model: SubmapModel) -> None:
    growing = GrowingSurround(HERE, FOCAL, False)
    growing.image(model, looking(0.0, 0.0))
    before = growing._drawn.copy()
    growing.image(model, looking(0.5, 0.0))
    added = growing._drawn & ~before
    assert 0 < added.sum() < 0.8 * before.sum()
    nothing = replace(model, gaussians=replace(model.gaussians, opacity_logits=model.gaussians.opacity_logits - 99))
    again, _ = growing.image(nothing, looking(0.25, 0.0))
    once, _ = GrowingSurround(HERE, FOCAL, False).image(model, looking(0.25, 0.0))
    np.testing.assert_allclose(again, once, atol=1.01)  # all of it was there


def test_an_image_does_not_depend_on_what_was_looked_at_before(model: SubmapModel) -> None:
    random = np.random.default_rng(4)
    used = GrowingSurround(HERE, FOCAL, True)
    for turn, up in random.uniform((-3.1, -0.5), (3.1, 0.5), (12, 2)):
        camera = looking(turn, up)
        for one, other in zip(
            used.image(model, camera), GrowingSurround(HERE, FOCAL, True).image(model, camera), strict=True
        ):
            assert np.array_equal(one, other)


def test_places_are_kept_as_long_as_memory_allows(model: SubmapModel) -> None:
    one = GrowingSurround(HERE, 96, False).bytes
    seen = PlacesSeen(3 * one)
    for x in (1.5, 2.0, 2.5, 3.0, 2.5):
        k = Intrinsics(120, 90, 80.0, 80.0, 60.0, 45.0)
        seen.image(model, Camera(k, camera_pose(np.array([x, 1.5, 1.3]), 0.0)), False)
    assert [key[0] for key in seen._places] == [2.0, 3.0, 2.5]
    small = PlacesSeen(0)
    small.image(model, looking(0, 0), False)
    small.image(model, looking(1, 0), False)
    assert len(small._places) == 1, "the one in use stays"
    small.clear()
    assert not small._places


def test_a_straight_view_looks_where_the_camera_does() -> None:
    camera = Camera(Intrinsics.from_fov(200, 150, math.radians(75)), camera_pose(HERE, 1.0, 0.3))
    seen = 2 * straight_view(direction_model(), camera) - 1
    np.testing.assert_allclose(seen, camera.rays(), atol=2e-3)


def test_a_straight_view_is_a_view_where_that_is_narrow(model: SubmapModel) -> None:
    camera = looking(0.3, 0.0, Intrinsics.from_fov(80, 80, math.radians(10)))
    direct = render_model(model, camera).rgb
    assert direct is not None
    error = np.clip(straight_view(model, camera), 0, 1) - np.clip(direct, 0, 1)
    assert np.sqrt((error**2).mean()) < 0.02
