"""The mask of a frame has the same position in the 3D view as in the photo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtGui import QColor, QImage, QPainter

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim_app.frames import pictures
from nvsim_app.layers.capture import FrameMaskLayer, pixel_homography

FRAME = Camera(Intrinsics(320, 240, 250.0, 245.0, 150.0, 130.0), camera_pose(np.array([1.0, 2.0, 1.5]), 0.4, -0.2))


def painted(layer: FrameMaskLayer, camera: Camera) -> QImage:
    image = QImage(camera.intrinsics.width, camera.intrinsics.height, QImage.Format.Format_RGB32)
    image.fill(QColor(0, 0, 0))
    painter = QPainter(image)
    layer.paint(painter, camera)
    painter.end()
    return image


@pytest.fixture
def layer(qapp) -> FrameMaskLayer:
    """A patch of the floor before the camera, 40 cm to a side, in a mask of half the photo's size."""
    made = FrameMaskLayer()
    view = FRAME.scaled(160, 120)
    rays = view.rays()
    ground = view.position + (-view.position[2] / np.minimum(rays[..., 2], -1e-6))[..., None] * rays
    patch = (np.abs(ground[..., :2] - (2.6, 5.0)) < 0.2).all(axis=-1) & (rays[..., 2] < 0)
    made.kept = pictures.tint(patch, "#ff0000")  # type: ignore[attr-defined]
    made.show(FRAME, made.kept.image)  # type: ignore[attr-defined]
    return made


@pytest.mark.parametrize(("heading", "elevation", "size"), [(0.4, -0.2, (640, 480)), (0.9, -0.5, (800, 300))])
def test_the_patch_stays_on_its_place_while_the_eye_turns(
    layer: FrameMaskLayer, heading: float, elevation: float, size: tuple[int, int]
) -> None:
    intrinsics = Intrinsics.from_fov(*size, math.radians(100))
    camera = Camera(intrinsics, camera_pose(FRAME.position, heading, elevation))
    image = painted(layer, camera)
    for x, y, red in ((2.6, 5.0, True), (2.75, 5.1, True), (2.95, 5.0, False), (2.6, 5.5, False)):
        ((u, v),), _ = camera.project(np.array([[x, y, 0.0]]))
        assert (image.pixelColor(int(u), int(v)).red() > 150) == red, (x, y)


def test_a_step_aside_or_a_look_back_hides_it(layer: FrameMaskLayer) -> None:
    aside = Camera(FRAME.intrinsics, camera_pose(FRAME.position + (0.1, 0, 0), 0.4, -0.2))
    back = Camera(FRAME.intrinsics, camera_pose(FRAME.position, 0.4 + math.pi, 0.0))
    black = QImage(320, 240, QImage.Format.Format_RGB32)
    black.fill(QColor(0, 0, 0))
    assert painted(layer, aside) == black and painted(layer, back) == black
    layer.show(None, None)
    assert painted(layer, FRAME) == black and layer.missing


def test_pixels_turn_as_rays_do() -> None:
    target = Camera(Intrinsics.from_fov(500, 400, 1.5), camera_pose(FRAME.position, 0.1, 0.3))
    point = FRAME.position + FRAME.rotation @ (0.3, -0.2, 2.0)
    (a,), _ = FRAME.project(point[None])
    (b,), _ = target.project(point[None])
    x, y, w = pixel_homography(FRAME, target) @ (*a, 1)
    assert w > 0 and np.allclose((x / w, y / w), b)
    same = pixel_homography(FRAME, replace(FRAME))
    assert np.allclose(same / same[2, 2], np.eye(3))
