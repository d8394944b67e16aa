"""Drawing only the tiles that are wanted: the same pixels there, nothing elsewhere, and less work."""

from __future__ import annotations

import numpy as np
import pytest
from test_render_forward import ALL, CAMERAS, scene

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_gaussians, render_model
from nvsim.render.workspace import RenderBuffers, pixels_of, tiles_of
from nvsim.splats.types import FloorTexture, SubmapModel


def regions(camera):
    k = camera.intrinsics
    one, scattered = np.zeros((k.height, k.width), bool), np.zeros((k.height, k.width), bool)
    one[20:30, 18:40] = True
    scattered[::25, ::31] = True
    return {"one": one, "scattered": scattered, "all": np.ones_like(one), "none": np.zeros_like(one)}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("region", ["one", "scattered", "all", "none"])
def test_wanted_tiles_are_drawn_as_in_the_whole_view_and_the_others_not(camera, region):
    tiles = tiles_of(regions(camera)[region])
    gaussians = scene(camera)
    whole = render_gaussians(gaussians, camera, ALL)
    part = render_gaussians(gaussians, camera, ALL, tiles=tiles)
    k = camera.intrinsics
    inside = pixels_of(tiles, k.height, k.width)
    for name in ALL:
        drawn = getattr(part, name)
        np.testing.assert_array_equal(drawn[inside], getattr(whole, name)[inside])
        assert not drawn[~inside].any()


def test_the_background_is_painted_in_wanted_tiles_only():
    camera = CAMERAS["centred"]
    texture = FloorTexture((np.full((2, 2, 3), 0.5, np.float32),), (-9.0, -9.0), (9.0, 9.0))
    model = SubmapModel(scene(camera, 50), None, texture, FloorSurface.flat(0.0))
    tiles = tiles_of(regions(camera)["one"])
    inside = pixels_of(tiles, 48, 64)
    whole, part = render_model(model, camera).rgb, render_model(model, camera, tiles=tiles).rgb
    np.testing.assert_array_equal(part[inside], whole[inside])
    assert not part[~inside].any()
    assert whole[~inside].any()


def test_tiles_that_are_not_wanted_are_not_sorted():
    camera = CAMERAS["centred"]
    gaussians, workspace = scene(camera), RenderBuffers()
    workspace.project(gaussians, camera, True)
    workspace.bin()
    whole, all_visible = workspace.intersections, workspace.visible
    workspace.project(gaussians, camera, True, tiles=tiles_of(regions(camera)["one"]))
    workspace.bin()
    assert 0 < workspace.intersections < whole / 2
    assert workspace.visible < all_visible


def test_tiles_of_another_size_are_refused():
    camera = CAMERAS["centred"]
    with pytest.raises(ValueError, match="tiles"):
        render_gaussians(scene(camera), camera, tiles=np.ones((1, 1), bool))


def test_a_crowd_stops_at_the_same_splat_whatever_else_is_drawn():
    camera = CAMERAS["centred"]
    gaussians = scene(camera, 3000)
    gaussians.opacity_logits += 3
    gaussians.log_scales += 1
    tiles = tiles_of(regions(camera)["one"])
    inside = pixels_of(tiles, 48, 64)
    whole = render_gaussians(gaussians, camera, ALL)
    part = render_gaussians(gaussians, camera, ALL, tiles=tiles)
    for name in ALL:
        np.testing.assert_array_equal(getattr(part, name)[inside], getattr(whole, name)[inside])
