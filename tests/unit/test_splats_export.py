"""Exported submaps: Gaussians in another frame look the same there, and the floor is a surface with its texture."""

from __future__ import annotations

import json
import struct

import cv2
import numpy as np
import pytest
from painted_background import render_background
from test_splats_formats import CAMERA, wall

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import matrix_from_quaternion, quaternion_from_matrix
from nvsim.render.model import render_gaussians
from nvsim.splats.floor_mesh import floor_gaussians, floor_mesh
from nvsim.splats.formats.glb import write_glb
from nvsim.splats.formats.gsply_formats import flip_y_and_z
from nvsim.splats.turning import transform_gaussians
from nvsim.splats.types import FloorTexture, Gaussians, SubmapModel


@pytest.mark.parametrize("seed", range(4))
def test_a_quaternion_of_a_matrix_makes_that_matrix(seed):
    rotation = matrix_from_quaternion(np.random.default_rng(seed).normal(size=4))
    np.testing.assert_allclose(matrix_from_quaternion(quaternion_from_matrix(rotation)), rotation, atol=1e-12)


def test_quaternions_of_half_turns_are_found():
    for diagonal in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        found = matrix_from_quaternion(quaternion_from_matrix(np.diag(diagonal)))
        np.testing.assert_allclose(found, np.diag(diagonal), atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_turned_gaussians_look_the_same_to_a_camera_that_turned_with_them(degree):
    gaussians = wall(degree=degree)
    rotation = matrix_from_quaternion([0.3, -0.5, 0.7, 0.2])
    pose = np.eye(4)
    pose[:3, :3] = rotation @ CAMERA.rotation
    pose[:3, 3] = 2.5 * rotation @ CAMERA.position
    moved = render_gaussians(transform_gaussians(gaussians, rotation, 2.5), Camera(CAMERA.intrinsics, pose))
    difference = np.abs(moved.rgb - render_gaussians(gaussians, CAMERA).rgb)
    # A pixel at the border of a Gaussian may fall on either side of the cut at an alpha of 1/255.
    assert difference.max() < 5e-3 and np.quantile(difference, 0.999) < 5e-5


def test_half_a_turn_about_x_is_the_change_of_axes_of_spz():
    gaussians = wall()
    for name in ("means", "sh"):
        expected = getattr(flip_y_and_z(gaussians), name)
        np.testing.assert_allclose(
            getattr(transform_gaussians(gaussians, np.diag([1, -1, -1])), name), expected, atol=1e-5
        )


def ramp_model():
    """A floor that rises to the north, with a texture of a red west and a green north-east corner."""
    heights = np.array([[0.0, 0.0], [0.5, 0.5]], np.float32)
    fine = np.zeros((40, 40, 3), np.float32)
    fine[:, :20, 0], fine[20:, 20:, 1] = 0.8, 0.6
    coarse = np.zeros((4, 4, 3), np.float32)
    texture = FloorTexture((coarse, fine), (-2.0, -2.0), (2.0, 2.0))
    return SubmapModel(Gaussians.empty(), None, texture, FloorSurface(heights, (0.0, -2.0), 4.0))


def test_the_surface_lies_on_the_floor_and_faces_up():
    model = ramp_model()
    mesh = floor_mesh(model)
    np.testing.assert_allclose(mesh.vertices[:, 2], model.floor.height_at(mesh.vertices[:, :2]), atol=1e-6)
    np.testing.assert_allclose(mesh.vertices[:, :2], -2 + 4 * mesh.uvs, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(16.0, rel=1e-5)


def test_the_picture_is_what_the_renderer_paints_on_the_floor():
    model = ramp_model()
    mesh = floor_mesh(model)
    eye = np.array([0.0, 0.0, 2.5])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]), eye  # straight down, north up
    camera = Camera(CAMERA.intrinsics, pose)
    painted = render_background(model, camera)
    spots = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    pixels, _ = camera.project(np.column_stack([spots, model.floor.height_at(spots)]))
    for (x, y), (u, v) in zip(spots, pixels, strict=True):
        texel = mesh.image[int((y + 2) / 4 * 40), int((x + 2) / 4 * 40)]
        if 0 <= u < 96 and 0 <= v < 72:
            np.testing.assert_allclose(texel[:3] / 255, painted[int(v), int(u)], atol=0.01)
        assert texel[3] == (0 if (x, y) == (1.0, -1.0) else 255)


def test_gaussians_of_the_floor_are_on_its_known_part_in_its_colors():
    model = ramp_model()
    found = floor_gaussians(model)
    x, y, z = found.means.T
    assert len(found) == pytest.approx(12.0 / 0.05**2, rel=0.01)  # three of four quarters are known
    assert not ((x > 0) & (y < 0)).any()
    np.testing.assert_allclose(z, model.floor.height_at(found.means[:, :2]), atol=1e-6)
    seen = render_gaussians(found, Camera(CAMERA.intrinsics, looking_down())).rgb
    painted = render_background(model, Camera(CAMERA.intrinsics, looking_down()))
    for row, column in ((18, 30), (18, 66), (54, 30)):
        np.testing.assert_allclose(seen[row, column], painted[row, column], atol=0.06)


def looking_down():
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 2.5)  # north up
    return pose


def test_a_model_without_texture_has_no_surface():
    bare = SubmapModel(Gaussians.empty(), None, None, FloorSurface.flat(0.0))
    assert floor_mesh(bare) is None and floor_gaussians(bare) is None


def test_the_file_is_glb_as_its_specification_says(tmp_path):
    mesh = floor_mesh(ramp_model())
    write_glb(tmp_path / "floor.glb", mesh, "floor")
    data = (tmp_path / "floor.glb").read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and size % 4 == 0
    root = json.loads(data[20 : 20 + size])
    body_size, kind = struct.unpack_from("<I4s", data, 20 + size)
    body = data[28 + size :]
    assert kind == b"BIN\0" and body_size == len(body) == root["buffers"][0]["byteLength"]

    def view(index):
        v = root["bufferViews"][index]
        return body[v["byteOffset"] : v["byteOffset"] + v["byteLength"]]

    corners = np.frombuffer(view(0), "<f4").reshape(-1, 3)
    np.testing.assert_array_equal(corners, mesh.vertices)
    assert root["accessors"][0]["count"] == len(corners)
    assert np.frombuffer(view(2), "<u4").max() == len(corners) - 1
    picture = cv2.imdecode(np.frombuffer(view(3), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(
        picture[..., [2, 1, 0, 3]][mesh.image[..., 3] > 0], mesh.image[mesh.image[..., 3] > 0]
    )
    # The node turns z up into glTF's y up.
    x, y, z, w = root["nodes"][0]["rotation"]
    np.testing.assert_allclose(matrix_from_quaternion([w, x, y, z]) @ [0, 0, 1], [0, 1, 0], atol=1e-12)
