"""Picking and projected segments against brute force and hand-made cases."""

from __future__ import annotations

import numpy as np

from nvsim_app.painting.cameras import ViewPose
from nvsim_app.painting.picking import nearest_point, projected_segments

CAMERA = ViewPose((0, 0, 0)).camera(800, 600)  # looks along +y


def test_of_two_points_under_the_cursor_the_nearer_one_is_picked() -> None:
    pixels, depths = np.array([[100.0, 100], [102, 100], [300, 300]]), np.array([9.0, 2.0, 1.0])
    assert nearest_point(pixels, depths, (100, 100), 10) == 1


def test_nothing_is_picked_far_from_every_point_or_behind_the_eye() -> None:
    pixels = np.array([[100.0, 100]])
    assert nearest_point(pixels, np.array([2.0]), (120, 100), 10) is None
    assert nearest_point(pixels, np.array([-2.0]), (100, 100), 10) is None
    assert nearest_point(np.zeros((0, 2)), np.zeros(0), (0, 0), 10) is None


def test_a_segment_in_front_ends_where_its_ends_project() -> None:
    a, b = np.array([[-1.0, 5, 0.5]]), np.array([[1.0, 8, -0.5]])
    lines, index, depth = projected_segments(CAMERA, a, b)
    expected, _ = CAMERA.project(np.concatenate([a, b]))
    assert np.allclose(lines[0], expected.reshape(-1))
    assert index.tolist() == [0] and np.isclose(depth[0], 5)


def test_a_segment_through_the_eye_plane_keeps_its_visible_part() -> None:
    """Its points are compared with those of the same segment sampled densely in front of the eye."""
    a, b = np.array([[0.3, -4.0, -0.2]]), np.array([[1.0, 6.0, 0.4]])
    lines, _, _ = projected_segments(CAMERA, a, b, near=0.05)
    share = np.linspace(0, 1, 5001)[:, None]
    points = a + share * (b - a)
    pixels, depth = CAMERA.project(points)
    pixels = pixels[depth > 0.5]
    direction = lines[0, 2:] - lines[0, :2]
    direction /= np.linalg.norm(direction)
    offset = (pixels - lines[0, :2]) @ np.array([-direction[1], direction[0]])
    assert np.abs(offset).max() < 1e-3
    assert np.allclose(lines[0, 2:], pixels[-1])


def test_what_lies_behind_or_beside_the_picture_is_left_out() -> None:
    a = np.array([[0, -5.0, 0], [200, 5.0, 0], [0, 5, 0]])
    b = np.array([[1, -2.0, 0], [200, 6.0, 0], [1, 5, 0]])
    assert projected_segments(CAMERA, a, b)[1].tolist() == [2]
