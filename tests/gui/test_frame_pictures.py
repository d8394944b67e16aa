"""Arrays as pictures: every channel in its place, and a difference that is the difference."""

from __future__ import annotations

import demo_room
import numpy as np
import pytest
from PySide6.QtGui import QColor

from nvsim.render.backends import RenderOutput
from nvsim_app.drawing.painter import Painter
from nvsim_app.drawing.render_child import Picture, Request, _answer
from nvsim_app.frames import pictures
from nvsim_app.frames.correction import Box
from nvsim_app.painting.value_colors import (
    ALPHA,
    CONFIRMED,
    DEPTH,
    MEASURED,
    NORMALS,
    alpha_shown,
    difference_scale,
    normal_shown,
    picture,
    ramp,
)

RNG = np.random.default_rng(5)


def pixel(painted: pictures.PaintedImage, x: int, y: int) -> tuple[int, int, int, int]:
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
    pictures.repaint_mask(painted, mask, "#2ec4b6", Box(2, 3, 6, 8))
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


@pytest.mark.parametrize("meters", [0.3, 0.5, 2.41, 7.0, 20.0])
def test_the_bar_has_the_color_of_the_image_where_the_value_lies(qapp, meters: float) -> None:
    red, green, blue, _ = pixel(pictures.depth(np.full((1, 1), meters, np.float32)), 0, 0)
    share = DEPTH.share(meters)
    at = DEPTH.colors[round(share * (len(DEPTH.colors) - 1))]
    assert np.abs(at.astype(int) - (red, green, blue)).max() <= 6
    views = round(share * 8) or 1
    shown = pixel(pictures.confidence(np.full((1, 1), views, np.uint8)), 0, 0)[:3]
    at = CONFIRMED.colors[round(CONFIRMED.share(views) * (len(CONFIRMED.colors) - 1))]
    assert np.abs(at.astype(int) - shown).max() <= 6


def test_every_swatch_of_the_normals_has_the_color_of_its_direction(qapp) -> None:
    ways = {"up": (0, 0, 1), "N": (0, 1, 0), "E": (1, 0, 0), "S": (0, -1, 0), "W": (-1, 0, 0), "down": (0, 0, -1)}
    painted = pictures.normals(np.array([list(ways.values())], np.float32))
    for x, (name, (rgb, words)) in enumerate(zip(ways, NORMALS.swatches, strict=True)):
        assert words == name and pixel(painted, x, 0)[:3] == rgb


def test_values_are_said_with_their_units() -> None:
    assert DEPTH.words(2.414) == "2.41 m" and DEPTH.words(0.0) == "no depth"
    assert ALPHA.words(0.8342) == "alpha 0.83"
    assert NORMALS.words(np.array([0.1, 0.2, 0.97])) == "normal up 0.97"
    assert NORMALS.words(np.array([0.0, -0.5, 0.0])) == "normal up 0.00, faces S", "a mean normal is shorter than 1"
    assert CONFIRMED.words(np.uint8(1)) == "confirmed by 1 image" and CONFIRMED.share(np.uint8(20)) == 1.0
    assert difference_scale(3.0).words(12) == "difference 12 of 255" and difference_scale(3.0).share(42.5) == 0.5


def test_a_pixel_of_a_render_tells_the_alpha_and_the_normal_that_it_shows() -> None:
    alpha = np.array([[1.0, 0.6, 0.3, 0.05]], np.float32)
    normal = np.array([[[0, 0.6, 0.8]]] * 4, np.float32).reshape(1, 4, 3)
    view = RenderOutput(None, alpha, None, normal)
    grays, colors = picture(view, "alpha")[0], picture(view, "normal")[0]
    for column, true in enumerate(alpha[0, :3]):
        known = alpha_shown(grays[column])
        assert known == pytest.approx(true, abs=1 / 255)
        assert normal_shown(colors[column], known) == pytest.approx(normal[0, column], abs=0.04)
    assert not normal_shown(colors[3], 0.05).any()


def test_the_drawing_process_sends_the_numbers_that_were_asked_for() -> None:
    source = demo_room.RoomSource().open()
    camera = demo_room.capture(1).frames[0].camera.scaled(32, 24)
    for channel in ("rgb", "alpha", "depth", "normal", "hole"):
        for asked in (False, True):
            answer = _answer(Painter(source), Request(0, camera, channel, False, values=asked))
            assert isinstance(answer, Picture) and answer.pixels.shape == (24, 32, 4)
            assert (answer.values is not None) == (asked and channel in MEASURED)
            if answer.values is not None:
                assert np.array_equal(answer.values, getattr(demo_room.cast(camera), channel))


def test_unknown_normals_are_transparent(qapp) -> None:
    values = np.zeros((2, 2, 3), np.float32)
    values[0, 0] = (0, 0, 1)
    painted = pictures.normals(values)
    assert pixel(painted, 0, 0) == (127, 127, 255, 255) and pixel(painted, 1, 1)[3] == 0


def test_a_picture_is_averaged_when_it_is_painted_small(qapp) -> None:
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 200
    photo = pictures.photo(stripes)
    small = photo.scaled_down(16, 16)
    assert abs(small.pixelColor(8, 8).red() - 100) < 8 and photo.scaled_down(16, 16) is small
    assert photo.scaled_down(60, 60) is photo.image
