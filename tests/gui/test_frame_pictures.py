"""Arrays as pictures: every channel in its place, and a difference that is the difference."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtGui import QColor

from app.frames import pictures
from app.frames.brush import Box
from app.painting.tones import ramp

RNG = np.random.default_rng(5)


def pixel(painted: pictures.Painted, x: int, y: int) -> tuple[int, int, int, int]:
    color = painted.image.pixelColor(x, y)
    return color.red(), color.green(), color.blue(), color.alpha()


def test_photos_and_renders_keep_their_channels_apart(qapp) -> None:
    rgb = RNG.integers(0, 255, (7, 13, 3), np.uint8)
    photo = pictures.photo(rgb)
    bgrx = np.concatenate([rgb[..., ::-1], np.full((7, 13, 1), 255, np.uint8)], axis=-1)
    render = pictures.render(bgrx)
    for x, y in ((0, 0), (12, 3), (5, 6)):
        assert pixel(photo, x, y)[:3] == pixel(render, x, y)[:3] == tuple(int(v) for v in rgb[y, x])


def test_a_mask_is_tinted_and_only_its_box_is_renewed(qapp) -> None:
    mask = RNG.random((9, 11)) > 0.5
    painted = pictures.tint(mask, "#2ec4b6")
    color = QColor("#2ec4b6")
    for y, x in np.ndindex(*mask.shape):
        expected = (color.red(), color.green(), color.blue(), 255) if mask[y, x] else (0, 0, 0, 0)
        assert pixel(painted, x, y) == expected
    before = painted.pixels.copy()
    mask[:] = ~mask
    pictures.retint(painted, mask, "#2ec4b6", Box(2, 3, 6, 8))
    assert pixel(painted, 3, 4)[3] == (255 if mask[4, 3] else 0)
    before[3:8, 2:6] = painted.pixels[3:8, 2:6]
    assert np.array_equal(before, painted.pixels)


@pytest.mark.parametrize("gain", [1.0, 4.0])
def test_the_difference_is_that_of_the_channel_that_differs_most(qapp, gain: float) -> None:
    a, b = RNG.integers(0, 255, (2, 6, 10, 3), np.uint8)
    found = pictures.difference(
        pictures.photo(a), pictures.render(np.dstack([b[..., ::-1], np.full((6, 10), 255, np.uint8)])), gain
    )
    most = np.abs(a.astype(int) - b.astype(int)).max(axis=-1)
    expected = ramp(np.clip(most * gain / 255, 0, 1)).astype(int)
    shown = np.array([[pixel(found, x, y)[:3] for x in range(10)] for y in range(6)])
    assert np.array_equal(shown, expected)


def test_unknown_normals_are_transparent(qapp) -> None:
    values = np.zeros((2, 2, 3), np.float32)
    values[0, 0] = (0, 0, 1)
    painted = pictures.normals(values)
    assert pixel(painted, 0, 0) == (127, 127, 255, 255) and pixel(painted, 1, 1)[3] == 0


def test_a_picture_is_averaged_when_it_is_painted_small(qapp) -> None:
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 200
    photo = pictures.photo(stripes)
    small = photo.shrunk(16, 16)
    assert abs(small.pixelColor(8, 8).red() - 100) < 8 and photo.shrunk(16, 16) is small
    assert photo.shrunk(60, 60) is photo.image
