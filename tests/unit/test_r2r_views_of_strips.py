"""Views sampled from a strip whose colours say where they look, against those colours."""

from __future__ import annotations

import math

import numpy as np
import pytest
from export_samples import sky

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.r2r.faces import face_rays
from nvsim.r2r.views_of_strips import StripViews, side_of

FOCAL = 60 / math.tan(math.radians(30))
INTRINSICS = Intrinsics(160, 120, FOCAL, FOCAL, 80, 60)


@pytest.mark.parametrize("tilt", [0.0, 0.1])
@pytest.mark.parametrize("yaw", [0.0, 0.7, 4.0])
def test_every_view_shows_what_lies_in_its_direction(yaw: float, tilt: float) -> None:
    rotation = look(np.zeros(3), yaw, tilt)[:3, :3]
    strip = np.concatenate(list(sky(face_rays(128) @ rotation.T)), axis=1)
    cameras = [
        Camera(INTRINSICS, look(np.zeros(3), math.radians(h), math.radians(e)))
        for h in range(0, 360, 30)
        for e in (-30, 0, 30, 80)
    ]
    sampler = StripViews(cameras, rotation, 128)
    for i, camera in enumerate(cameras):
        away = np.abs(sampler.view(strip, i).astype(int) - sky(camera.rays()))
        assert away.max() <= 3  # over the border of a face nothing is interpolated: half a pixel of the 90 degrees


def test_the_border_of_a_face_shows_nothing_of_the_next_in_the_strip() -> None:
    """Up and back lie side by side in the strip, and nowhere else."""
    strip = np.zeros((32, 192, 3), np.uint8)
    strip[:, :32] = 255
    level = look(np.zeros(3), 0.0)[:3, :3]
    camera = Camera(INTRINSICS, look(np.zeros(3), math.pi))  # the back, level
    assert StripViews([camera], level, 32).view(strip, 0).max() == 0


def test_a_strip_must_be_six_squares() -> None:
    with pytest.raises(InputError, match="600x90 pixels; a strip is six square faces"):
        side_of(np.zeros((90, 600, 3), np.uint8), "a.jpg")
