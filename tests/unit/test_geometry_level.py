"""The frame of a camera turned level."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose, level_of, level_rays
from nvsim.networks.image_preparation import Placement
from nvsim.perception.semantic_network import placed_rays

LENS = Intrinsics.from_fov(64, 48, 1.2)


@pytest.mark.parametrize("elevation", [-np.pi / 2, -0.8, 0.0, 0.5])
@pytest.mark.parametrize("heading", [0.0, 1.0, 4.0])
def test_it_keeps_the_heading_whatever_the_elevation(heading: float, elevation: float) -> None:
    level = level_of(Camera(LENS, camera_pose(np.zeros(3), heading, elevation)))
    assert np.allclose(level @ level.T, np.eye(3)) and np.isclose(np.linalg.det(level), 1)
    assert np.allclose(level[1], (0, 0, -1))
    assert np.allclose(level[2], (np.sin(heading), np.cos(heading), 0), atol=1e-9)


def test_an_image_on_its_side_has_the_heading_of_its_optical_axis() -> None:
    pose = camera_pose(np.zeros(3), 0.7, 0.1)
    pose[:3, :2] = pose[:3, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
    assert np.allclose(level_of(Camera(LENS, pose))[2], (np.sin(0.7), np.cos(0.7), 0), atol=1e-9)


def test_the_rays_of_a_level_camera_are_its_own() -> None:
    camera = Camera(LENS, camera_pose(np.zeros(3), 2.0))
    rays = level_rays(camera)
    u, v = (40.5 - LENS.cx) / LENS.fx, (7.5 - LENS.cy) / LENS.fy
    assert np.allclose(rays[7, 40], np.array([u, v, 1]) / np.linalg.norm([u, v, 1]), atol=1e-6)


def test_a_stretched_image_has_the_rays_of_what_its_pixels_show() -> None:
    camera = Camera(LENS, camera_pose(np.zeros(3), 2.0, -0.5))
    rays = placed_rays(camera, Placement(48, 64, 96, 32, 0, 0, 32, 96))
    assert rays.shape == (1, 3, 96, 32)
    both = level_rays(camera).reshape(48, 32, 2, 3).mean(axis=2)  # two columns in one, each row twice
    twice = rays[0].transpose(1, 2, 0).reshape(48, 2, 32, 3).mean(axis=1)
    assert np.abs(both - twice).max() < 2e-3


def test_a_border_lies_beside_the_image_in_rays_too() -> None:
    camera = Camera(LENS, camera_pose(np.zeros(3), 2.0, -0.5))
    rays = placed_rays(camera, Placement(48, 64, 64, 64, 0, 8, 64, 48))
    assert np.allclose(rays[0].transpose(1, 2, 0)[8:56], level_rays(camera), atol=1e-6)
