"""Pictures of channels whose values are known."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.render.backends import RenderOutput
from nvsim_app.painting.value_colors import CHANNELS, DEPTH_RANGE, picture, ramp


def view() -> RenderOutput:
    rgb = np.array([[[1.0, 0.5, -0.2], [2.0, 0.0, 0.25]]], np.float32)
    alpha = np.array([[1.0, 0.0]], np.float32)
    depth = np.array([[2.0, 0.0]], np.float32)
    normal = np.array([[[0, 0, 1.0], [0, 0, 0]]], np.float32)
    return RenderOutput(rgb, alpha, depth, normal)


def test_colors_are_clamped_and_stored_blue_first() -> None:
    assert picture(view(), "rgb")[0].tolist() == [[0, 127, 255, 255], [63, 0, 255, 255]]


def test_alpha_is_gray() -> None:
    assert picture(view(), "alpha")[0].tolist() == [[255, 255, 255, 255], [0, 0, 0, 255]]


def test_what_no_gaussian_covers_shines_in_a_color_of_its_own() -> None:
    covered, hole = picture(view(), "hole")[0]
    assert covered.tolist() == [0, 127, 255, 255]
    assert hole.tolist() == [int(min(255, 180 + 0.25 * 255)), 64, 255, 255]


def test_an_upward_normal_is_blue_and_emptiness_is_dark() -> None:
    up, nothing = picture(view(), "normal")[0]
    assert up.tolist() == [255, 127, 127, 255] and nothing[:3].max() < 40


def test_nearer_is_brighter() -> None:
    depth = np.geomspace(*DEPTH_RANGE, 12).astype(np.float32)[None]
    shown = picture(RenderOutput(alpha=np.ones_like(depth), depth=depth), "depth")[0, :, :3].astype(float)
    luminance = shown @ (0.114, 0.587, 0.299)
    assert (np.diff(luminance) < 0).all()
    assert ramp(np.array([-1.0, 2.0])).shape == (2, 3)


@pytest.mark.parametrize("channel", CHANNELS)
def test_the_view_that_was_given_stays_as_it_is(channel: str) -> None:
    given = view()
    before = {k: v.copy() for k, v in vars(given).items()}
    picture(given, channel)
    for name, array in before.items():
        assert np.array_equal(getattr(given, name), array)


def test_a_channel_that_was_not_rendered_is_refused() -> None:
    with pytest.raises(ValueError, match="depth"):
        picture(RenderOutput(), "depth")
