"""Positions of floor pixels in a view, and the values read there, compared with the camera's projection and scipy's
interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import Sphere
from nvsim.mapping.views.floor_pixels import Eye, FloorPixels

WIDTH, HEIGHT = 40, 30


def places(seed: int) -> NDArray[np.float64]:
    """(30, 18, 3) on uneven floor all around, many of them outside the view."""
    return np.random.default_rng(seed).uniform((-3, -3, -0.1), (3, 3, 0.1), (30, 18, 3))


def eyes() -> list[Eye]:
    camera = Camera(
        Intrinsics(WIDTH, HEIGHT, 17.0, 19.0, 21.0, 14.0), camera_pose(np.array([0.2, 0.1, 1.4]), 0.7, -0.8)
    )
    return [camera, Sphere(np.array([0.2, 0.1, 1.4]), WIDTH, HEIGHT, 0.3)]


@pytest.mark.parametrize("eye", eyes(), ids=["camera", "panorama"])
@pytest.mark.parametrize("seed", range(3))
def test_an_image_is_read_where_the_eye_sees_the_places(eye: Eye, seed: int) -> None:
    points = places(seed)
    pixels, depth = eye.project(points)
    u, v = pixels[..., 0], pixels[..., 1]
    inside = (depth > 0) & (u > -1) & (u < WIDTH + 1) & (v > -1) & (v < HEIGHT + 1)
    found = FloorPixels.of(eye, points)
    assert np.array_equal(found.inside, inside) and np.allclose(found.depth, depth)
    assert inside.all() if isinstance(eye, Sphere) else 0.1 < inside.mean() < 0.9

    image = np.random.default_rng(seed).random((HEIGHT, WIDTH)).astype(np.float32)
    beside = "wrap" if isinstance(eye, Sphere) else "edge"
    around = np.pad(np.pad(image, ((1, 1), (0, 0)), "edge"), ((0, 0), (2, 2)), beside)
    expected = map_coordinates(around.astype(np.float64), [v + 0.5, u + 1.5], order=1, mode="nearest")
    np.testing.assert_allclose(found.values(image, -7.0), np.where(inside, expected, -7.0), atol=1e-6)

    read = np.zeros((HEIGHT, WIDTH), bool)
    found.mark(read)
    assert found.are_marked(read) and found.are_marked(np.ones_like(read))
    kept = found.values(np.where(read, image, np.float32(np.nan)), -7.0)
    np.testing.assert_array_equal(kept, found.values(image, -7.0))
    row, column = np.argwhere(read)[seed]
    read[row, column] = False
    assert not found.are_marked(read)
