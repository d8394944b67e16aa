"""Gaussians that are ruled out together: none that a view shows is among them."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.by_rays import is_wide
from nvsim.render.model import render_model
from nvsim.render.nearby import NeighborGroups
from nvsim.render.scene import render_regions
from nvsim.render.workspace import tiles_of
from nvsim.splats.types import Gaussians, SubmapModel

GEOMETRY = frozenset({"alpha", "depth", "normal"})


def hall(seed: int, count: int = 20_000) -> Gaussians:
    """Gaussians of a millimeter to some meters, all around the origin, a few of them far away."""
    r = np.random.default_rng(seed)
    means = r.uniform(-12, 12, (count, 3)) * [1, 1, 0.15]
    means[:50] *= 100
    scales = r.normal(-4, 1.0, (count, 3))
    scales[50:90] += 5
    arrays = (means, scales, r.normal(size=(count, 4)), r.normal(0, 2, count), r.normal(0, 0.2, (count, 4, 3)))
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))


def view(seed: int, size: int = 96) -> tuple[Camera, np.ndarray]:
    """A view down from somewhere in the hall, and a part of its pixels."""
    r = np.random.default_rng(100 + seed)
    pose = camera_pose(r.uniform(-5, 5, 3) * [1, 1, 0.2], r.uniform(0, 2 * np.pi), r.uniform(-np.pi / 2, 0.3))
    mask = np.zeros((size, size), bool)
    (x, y), (w, h) = r.integers(0, size - 20, 2), r.integers(1, size // 2, 2)
    mask[y : y + h, x : x + w] = True
    return Camera(Intrinsics.from_fov(size, size, np.radians(100)), pose), mask


@pytest.mark.parametrize("seed", range(12))
def test_a_region_without_colors_is_that_of_the_whole_view_to_the_last_bit(seed: int) -> None:
    model = SubmapModel(hall(seed), None, None, FloorSurface.flat(0.0))
    camera, mask = view(seed)
    whole, part = (render_regions(model, [camera], [m], GEOMETRY)[0] for m in (np.ones_like(mask), mask))
    assert whole.alpha is not None and whole.alpha[mask].any()
    for name in GEOMETRY:
        np.testing.assert_array_equal(getattr(part, name)[mask], getattr(whole, name)[mask])


@pytest.mark.parametrize("seed", range(12))
def test_without_what_is_wide_for_its_depth_a_region_is_that_of_the_colored_view(seed: int) -> None:
    gaussians, (camera, mask) = hall(seed), view(seed)
    gaussians.opacity_logits[is_wide(gaussians, np.arange(len(gaussians)), camera)] = -20
    model = SubmapModel(gaussians, None, None, FloorSurface.flat(0.0))
    whole, part = render_model(model, camera, GEOMETRY), render_regions(model, [camera], [mask], GEOMETRY)[0]
    for name in GEOMETRY:
        np.testing.assert_allclose(getattr(part, name)[mask], getattr(whole, name)[mask], atol=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_most_of_those_that_are_out_of_view_are_ruled_out(seed: int) -> None:
    gaussians, (camera, mask) = hall(seed), view(seed)
    rows = NeighborGroups(gaussians).rows(camera, tiles_of(mask))
    assert (np.diff(rows) > 0).all()
    assert len(rows) < 0.8 * len(gaussians)


def test_what_is_nowhere_is_drawn_by_nobody() -> None:
    gaussians, (camera, mask) = hall(0, 500), view(0)
    gaussians.means[100:120] = np.nan
    rows = NeighborGroups(gaussians).rows(camera, tiles_of(mask))
    assert not np.isin(np.arange(100, 120), rows).any()
    assert len(NeighborGroups(Gaussians.empty()).rows(camera, tiles_of(mask))) == 0
