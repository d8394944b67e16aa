"""Motions of the eye against what geometry says they must keep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim_app.painting import cameras
from nvsim_app.painting.cameras import ViewPose

poses = st.builds(
    ViewPose,
    st.tuples(*(st.floats(-20, 20) for _ in range(3))),
    st.floats(-3, 3),
    st.floats(-1.2, 1.2),
    st.floats(0.5, 30),
)
drags = st.floats(-40, 40)


@given(poses, drags, drags)
def test_orbit_keeps_the_pivot_and_its_distance(pose: ViewPose, dx: float, dy: float) -> None:
    after = cameras.orbit_pose(pose, dx, dy)
    assert np.allclose(after.pivot, pose.pivot, atol=1e-6)
    assert math.isclose(float(np.linalg.norm(after.pivot - after.position)), pose.reach, rel_tol=1e-9)


@given(poses, drags, drags)
def test_pan_keeps_the_pivot_under_the_cursor(pose: ViewPose, dx: float, dy: float) -> None:
    after = cameras.pan_pose(pose, dx, dy, 600)
    before_pixel, _ = pose.camera(800, 600).project(pose.pivot)
    pixel, _ = after.camera(800, 600).project(pose.pivot)
    assert np.allclose(pixel - before_pixel, (dx, dy), atol=1e-6)


@given(poses, st.floats(0.5, 0.95), st.floats(100, 700), st.floats(100, 500))
def test_zoom_keeps_what_is_under_the_cursor(pose: ViewPose, factor: float, u: float, v: float) -> None:
    camera = pose.camera(800, 600)
    k = camera.intrinsics
    ray = camera.rotation @ [(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0]
    point = camera.position + pose.reach * ray
    after = cameras.zoomed(pose, factor, ray / np.linalg.norm(ray))
    pixel, depth = after.camera(800, 600).project(point)
    assert np.allclose(pixel, (u, v), atol=1e-4)
    assert math.isclose(float(depth), pose.reach * factor, rel_tol=1e-6)


def test_zoom_can_always_go_on() -> None:
    pose = ViewPose((0, 0, 0), reach=1.0)
    for _ in range(60):
        pose = cameras.zoomed(pose, 0.8)
    assert pose.position[1] > 1.5  # through the former pivot and on


@given(poses, drags, drags)
def test_looking_around_stays_in_place_and_never_turns_over(pose: ViewPose, dx: float, dy: float) -> None:
    after = cameras.turn_pose(pose, dx, dy)
    assert after.position == pose.position
    assert abs(after.elevation) <= math.pi / 2
    assert after.axes[2, 1] <= 1e-9  # the picture's down never points up


def test_flying_forward_at_heading_east_moves_along_x() -> None:
    after = cameras.fly_pose(ViewPose((1, 2, 3), heading=math.pi / 2), forward=2.0, right=0.0, up=0.5)
    assert np.allclose(after.position, (3, 2, 3.5))


def test_top_view_sees_everything_with_north_up() -> None:
    points = np.array([[-3, 2, 0], [9, 2, 0], [3, -4, 1], [3, 8, 1.0]])
    pixels, depth = cameras.top_view(points, 16 / 9).camera(1600, 900).project(points)
    assert (depth > 0).all()
    assert ((pixels > 0) & (pixels < (1600, 900))).all()
    assert pixels[3, 1] < pixels[2, 1]  # larger y is higher in the picture
    assert pixels[1, 0] > pixels[0, 0]


def test_overview_sees_everything() -> None:
    points = np.random.default_rng(2).uniform((-8, -5, 0), (12, 9, 3), (200, 3))
    pixels, depth = cameras.overview(points).camera(1000, 700).project(points)
    assert (depth > 0).all()
    assert ((pixels > 0) & (pixels < (1000, 700))).all()


def test_a_frame_is_seen_through_its_own_camera() -> None:
    frame = Camera(Intrinsics(640, 480, 420, 420, 320, 240), camera_pose(np.array([1.0, 2.0, 1.5]), 0.7, -0.2))
    camera = cameras.seen_from_frame(frame).camera(640, 480)
    assert np.allclose(camera.camera_to_world, frame.camera_to_world, atol=1e-9)
    assert camera.intrinsics.fy == pytest.approx(420)


def test_focus_puts_the_point_ahead() -> None:
    pose = cameras.focused(ViewPose((0, 0, 2), 1.0, -0.3), np.array([4.0, 5.0, 1.0]), 2.5)
    assert np.allclose(pose.pivot, (4, 5, 1))


def test_a_flight_takes_the_shorter_turn_and_ends_at_the_goal() -> None:
    a, b = ViewPose((0, 0, 1), math.radians(170)), ViewPose((2, 0, 1), math.radians(-170), 0.3, 6.0)
    middle = cameras.interpolate_poses(a, b, 0.5)
    assert abs(math.degrees(middle.heading)) == pytest.approx(180, abs=1e-6)
    end = cameras.interpolate_poses(a, b, 1.0)
    assert np.allclose(end.axes, b.axes) and end.position == b.position and end.reach == pytest.approx(b.reach)


def test_an_edge_is_looked_along_from_its_nearer_end() -> None:
    eyes = np.array([[0.0, 0.0, 1.5], [3.0, 0.0, 1.5]])
    feet = eyes - [0.0, 0.0, 1.5]
    pose = cameras.view_along_edge(ViewPose((-4.0, 1.0, 9.0)), eyes, feet)
    assert pose.position == (0.0, 0.0, 1.5) and pose.heading == pytest.approx(np.pi / 2)
    pixels, depths = pose.camera(600, 400).project(np.array([[3.0, 0.0, 0.0]]))
    assert depths[0] > 0 and 0 < pixels[0, 0] < 600 and 0 < pixels[0, 1] < 400
    assert cameras.view_along_edge(ViewPose((9.0, 0.0, 1.5)), eyes, feet).position == (3.0, 0.0, 1.5)
