"""Cameras, rotations and the floor surface against closed forms."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import is_rigid, matrix_from_quaternion, smallest_rotation

ANGLE = st.floats(-3.1, 3.1)
VECTOR = st.tuples(*[st.floats(-5, 5)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-2)


@given(ANGLE, st.floats(-1.4, 1.4))
def test_a_look_is_rigid_and_faces_where_it_says(heading, elevation):
    pose = camera_pose(np.array([1.0, 2.0, 3.0]), heading, elevation)
    assert is_rigid(pose)
    forward = [np.sin(heading) * np.cos(elevation), np.cos(heading) * np.cos(elevation), np.sin(elevation)]
    np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-12)
    assert pose[2, 1] <= 1e-12  # the camera's down axis never points up


@given(VECTOR)
def test_points_along_a_pixels_ray_project_onto_that_pixel(position):
    camera = Camera(Intrinsics(8, 6, 7.0, 6.5, 3.7, 3.1), camera_pose(np.array(position), 0.4, -0.3))
    pixels, depth = camera.project(camera.position + 2.5 * camera.rays().astype(np.float64))
    u, v = np.meshgrid(np.arange(8) + 0.5, np.arange(6) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([u, v], -1), atol=1e-4)
    assert (depth > 0).all()


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-2))
def test_quaternions_agree_with_scipy(q):
    w, x, y, z = q
    np.testing.assert_allclose(matrix_from_quaternion(q), Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-9)


@given(VECTOR, VECTOR)
def test_the_smallest_rotation_turns_one_direction_into_the_other_by_their_angle(a, b):
    r = smallest_rotation(a, b)
    a, b = np.array(a) / np.linalg.norm(a), np.array(b) / np.linalg.norm(b)
    np.testing.assert_allclose(r @ a, b, atol=1e-6)
    angle = np.arccos(np.clip(a @ b, -1, 1))
    assert abs(np.linalg.norm(Rotation.from_matrix(r).as_rotvec()) - angle) < 1e-5


def test_a_reflection_is_not_rigid():
    assert not is_rigid(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert not is_rigid(np.full((4, 4), np.nan))


def test_rays_meet_a_ramp_where_geometry_says():
    x = np.arange(11, dtype=np.float32)
    ramp = FloorSurface(np.tile(0.1 * x, (2, 1)), (0.0, 0.0), 1.0)
    origin = np.array([2.0, 0.5, 2.0])
    direction = np.array([0.6, 0.0, -0.8])
    t = ramp.distance_along_rays(origin, direction[None], iterations=20)[0]
    assert abs(t - 1.8 / 0.86) < 1e-4  # 2 - 0.8 t = 0.1 (2 + 0.6 t)
    assert np.isinf(ramp.distance_along_rays(origin, np.array([[0.0, 0.0, 1.0]]))[0])
