"""Points are tracked through a video to where a known motion takes them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from textured_video import HEIGHT, WIDTH, blurred, colored, shifted, texture, view

from nvsim.footage.tracking import (
    TrackedFrame,
    frame_without_points,
    sharpness_change,
    shrunk_gray,
    track_points,
    with_new_points,
)

PLANE = texture()
FIRST = shifted(200, 120)
TURNED = np.array([[1.02, 0.03, -4.0], [-0.025, 1.01, 5.0], [4e-5, -3e-5, 1.0]])


def start() -> TrackedFrame:
    return with_new_points(frame_without_points(view(PLANE, FIRST)), 0)


def carried(places: NDArray[np.float32], motion: NDArray[np.float64]) -> NDArray[np.float64]:
    flat = np.column_stack([places, np.ones(len(places))]) @ motion.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


@pytest.mark.parametrize("motion", [np.eye(3), shifted(9.3, -4.6), TURNED], ids=["still", "shifted", "turned"])
def test_points_are_where_the_homography_takes_them(motion: NDArray[np.float64]) -> None:
    before = start()
    after = track_points(before, view(PLANE, motion @ FIRST))
    mine, theirs = before.shared_with(after)
    off = np.linalg.norm(carried(before.places[mine], motion) - after.places[theirs], axis=1)
    assert len(mine) > 0.8 * len(before.ids) > 50
    assert np.percentile(off, 95) < 0.3 and off.max() < 1


def test_the_motion_of_a_frame_is_the_homography() -> None:
    after = track_points(start(), view(PLANE, TURNED @ FIRST))
    corners = np.array([[0, 0], [WIDTH, 0], [0, HEIGHT], [WIDTH, HEIGHT]], np.float32)
    assert np.abs(carried(corners, after.motion) - carried(corners, TURNED)).max() < 0.5


def test_points_are_never_outside_the_image_while_the_camera_moves() -> None:
    tracked = start()
    next_id = int(tracked.ids.max()) + 1
    for k in range(1, 13):
        tracked = with_new_points(tracked, next_id)
        next_id = int(tracked.ids.max()) + 1
        tracked = track_points(tracked, view(PLANE, shifted(200 + 14.5 * k, 120 - 6 * k)))
        assert (tracked.places >= 0).all() and (tracked.places <= (WIDTH - 1, HEIGHT - 1)).all()
        assert (np.diff(tracked.ids) > 0).all()
        assert len(tracked.ids) > 40


def test_new_points_keep_the_old_ones_and_are_apart_from_them() -> None:
    first = track_points(start(), view(PLANE, shifted(240, 120)))
    more = with_new_points(first, 5000)
    assert np.array_equal(more.ids[: len(first.ids)], first.ids) and more.ids[len(first.ids)] == 5000
    assert len(np.unique(more.ids)) == len(more.ids) > len(first.ids)
    assert np.array_equal(more.places[: len(first.ids)], first.places)
    new = more.places[len(first.ids) :]
    apart = np.linalg.norm(new[:, None] - first.places[None], axis=2).min()
    assert apart > 3


def test_an_image_without_texture_has_no_points() -> None:
    plain = np.full((HEIGHT, WIDTH), 128, np.uint8)
    nothing = with_new_points(frame_without_points(plain), 0)
    assert len(nothing.ids) == 0
    assert len(track_points(nothing, view(PLANE, FIRST)).ids) == 0
    assert len(track_points(start(), plain).ids) == 0
    assert track_points(start(), plain).gray is plain


def test_a_blurred_image_is_less_sharp_by_its_common_points() -> None:
    before, image = start(), view(PLANE, shifted(203, 120))
    same, smeared = track_points(before, image), track_points(before, blurred(image, 7))
    assert sharpness_change(before, same) == pytest.approx(1, abs=0.1)
    assert sharpness_change(before, smeared) < 0.7
    assert sharpness_change(before, frame_without_points(image)) == 1.0


def test_a_large_image_is_shrunk_and_a_small_one_kept() -> None:
    small = colored(view(PLANE, FIRST))
    assert np.array_equal(shrunk_gray(small), cv2.cvtColor(small, cv2.COLOR_BGR2GRAY))
    assert shrunk_gray(cv2.resize(small, (1600, 1200))).shape == (480, 640)
    assert shrunk_gray(np.ascontiguousarray(cv2.resize(small, (1600, 1200)).swapaxes(0, 1))).shape == (640, 480)
