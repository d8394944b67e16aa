"""The size of moving pictures on a machine whose cost per pixel is known."""

from __future__ import annotations

import pytest

from nvsim_app.drawing.picture_feed import SMALLEST, ImageSizeControl


def settle(
    nanoseconds_per_pixel: float, fixed_ms: float, width: int = 1280, height: int = 720
) -> tuple[int, int, float]:
    pacing = ImageSizeControl(40.0)
    for _ in range(80):
        w, h = pacing.size_while_moving(width, height)
        cost = fixed_ms + w * h * nanoseconds_per_pixel * 1e-6
        pacing.learn(w, h, width, height, cost)
    return w, h, cost


def test_a_fast_machine_moves_at_full_size() -> None:
    assert settle(20, 1.0)[:2] == (1280, 720)


@pytest.mark.parametrize("cost", [70, 100, 150])
def test_the_pace_is_held_by_smaller_pictures(cost: float) -> None:
    w, h, ms = settle(cost, 2.0)
    assert 25 < ms < 46 and w < 1280
    assert abs(w / h - 1280 / 720) < 0.02


def test_no_picture_is_smaller_than_the_least() -> None:
    w, h, _ = settle(5000, 50.0)
    assert w >= SMALLEST[0] and h >= SMALLEST[1] - 1


def test_a_small_window_is_not_enlarged() -> None:
    assert settle(5000, 50.0, 320, 200)[:2] == (320, 200)
