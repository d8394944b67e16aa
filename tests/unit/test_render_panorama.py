"""Panoramas against closed forms: a background that is a direction, a sphere, and views drawn directly."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from nvsim.benchmarks.panorama import furnished_hall, measure
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import cube, skybox
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.backends import RenderOutput
from nvsim.render.model import render_model
from nvsim.render.panorama import render_cube, render_equirectangular, write_panorama
from nvsim.render.scene import render_regions
from nvsim.splats.types import Background, Gaussians, SubmapModel

ALL = frozenset({"rgb", "alpha", "depth", "normal"})
HERE = np.array([1.0, -2.0, 1.5])
RADIUS = 4.0


def compass() -> SubmapModel:
    """A background whose red, green and blue are the x, y and z of the direction."""
    unit = math.sqrt(3 / (4 * math.pi))
    rest = np.zeros((24, 3), np.float32)  # first degree: -y, z, -x
    rest[0, 1], rest[1, 2], rest[2, 0] = -1 / unit, 1 / unit, -1 / unit
    f = np.float32
    weights = {
        "embed.0.weight": np.zeros((1, 27), f),
        "embed.0.bias": np.zeros(1, f),
        "trunk.0.weight": np.zeros((1, 1), f),
        "trunk.0.bias": np.zeros(1, f),
        "base.weight": np.zeros((3, 1), f),
        "base.bias": np.zeros(3, f),
        "rest.weight": np.zeros((72, 1), f),
        "rest.bias": rest.reshape(-1),
    }
    return SubmapModel(Gaussians.empty(), Background(weights), None, FloorSurface.flat(0))


def sphere(count: int = 30_000) -> SubmapModel:
    """Flat Gaussians that tile a sphere of RADIUS around HERE, colored by a smooth function of the direction."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, math.pi * (1 + math.sqrt(5)) * i
    flat = np.sqrt(1 - z * z)
    d = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    spacing = RADIUS * math.sqrt(4 * math.pi / count)
    scales = np.tile(np.log([0.8 * spacing, 0.8 * spacing, 0.01]), (count, 1))
    # The rotation that takes z to d: half way between them, by half a turn's cosine.
    quats = np.stack([1 + d[:, 2], -d[:, 1], d[:, 0], np.zeros(count)], axis=1)
    quats[np.abs(quats).max(axis=1) < 1e-6] = (0, 1, 0, 0)
    sh = ((0.5 + 0.4 * np.sin(3 * d)) - 0.5)[:, None, :] / 0.28209479177387814
    arrays = (HERE + RADIUS * d, scales, quats, np.full(count, 3.0), sh)
    g = Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))
    return SubmapModel(g, None, None, FloorSurface.flat(-9))


def directions(width: int, height: int, heading: float = 0.0) -> np.ndarray:
    """(H, W, 3) of the pixel centers, as the convention says: the middle column is `heading`, clockwise."""
    azimuth = heading + ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    flat = np.cos(elevation)[:, None]
    up = np.broadcast_to(np.sin(elevation)[:, None], (height, width))
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up], axis=-1)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
def test_every_pixel_shows_its_own_direction(heading):
    image = render_equirectangular(compass(), HERE, 128, 64, heading=heading)
    np.testing.assert_allclose(image.rgb, directions(128, 64, heading), atol=2e-3)
    assert not image.alpha.any()
    assert image.depth is None and image.normal is None


def test_on_a_sphere_alpha_distance_and_normal_are_the_same_everywhere():
    image = render_equirectangular(sphere(), HERE, 192, 96, ALL)
    assert image.alpha.min() > 0.98
    np.testing.assert_allclose(image.depth, RADIUS, rtol=0.05)  # means of centers that lie around the ray
    facing = -(image.normal * directions(192, 96)).sum(-1) / image.alpha
    assert facing.min() > 0.98
    truth = 0.5 + 0.4 * np.sin(3 * directions(192, 96))
    assert np.abs(image.rgb / image.alpha[..., None] - truth).max() < 0.03


def test_channels_do_not_depend_on_which_others_are_asked_for():
    model = sphere(2000)
    whole = render_equirectangular(model, HERE, 96, 48, ALL)
    for name in ALL:
        alone = render_equirectangular(model, HERE, 96, 48, frozenset({name}))
        np.testing.assert_array_equal(getattr(alone, name), getattr(whole, name))
        assert all(getattr(alone, other) is None for other in ALL - {name})


def test_no_edge_between_views_can_be_seen():
    width = 256
    image = render_equirectangular(sphere(), HERE, width, width // 2, ALL)
    level = slice(width // 4 - 12, width // 4 + 12)  # there the edges between views are upright
    distance = image.depth[level]
    steps = np.abs(np.diff(distance, axis=1)).mean(axis=0)
    seams = [width // 16 + k * width // 8 - 1 for k in range(8)]
    elsewhere = np.delete(steps, [s + d for s in seams for d in (-1, 0, 1)])
    assert steps[seams].max() < 1.5 * elsewhere.max()


@pytest.mark.parametrize("heading,elevation", [(0, 0), (45, 0), (45, 35.26), (180, 45), (0, 90), (270, -60), (180, 0)])
def test_a_panorama_is_what_a_narrow_view_shows(heading, elevation):
    model, width, size = sphere(), 512, 32
    image = render_equirectangular(model, HERE, width, width // 2)
    pose = camera_pose(HERE, math.radians(heading), math.radians(elevation))
    camera = Camera(Intrinsics.from_fov(size, size, size * 2 * math.pi / width), pose)
    rays = camera.rays()
    x = (np.arctan2(rays[..., 0], rays[..., 1]) / (2 * np.pi) + 0.5) * width - 0.5
    y = (0.5 - np.arcsin(np.clip(rays[..., 2], -1, 1)) / np.pi) * (width // 2) - 0.5
    around = np.concatenate([image.rgb[:, -1:], image.rgb, image.rgb[:, :1]], axis=1)
    shown = cv2.remap(around, (x + 1).astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    mse = np.mean((shown - render_model(model, camera).rgb) ** 2)
    assert -10 * math.log10(mse) > 40  # 38 with the six views of a cube


def test_faces_of_a_cube_are_views_of_90_degrees():
    model = compass()
    for face, camera in zip(render_cube(model, HERE, 24, heading=0.4), cube(HERE, 24, 0.4), strict=True):
        np.testing.assert_allclose(face.rgb, camera.rays(), atol=1e-5)


def test_a_skybox_has_the_order_and_orientation_of_matterport():
    # Direction of the pixel at u right and r down, both in [-1, 1], along the pose's right, down and forward axes.
    table = [
        lambda u, r: (-u, -1, -r),
        lambda u, r: (-u, r, -1),
        lambda u, r: (-1, r, u),
        lambda u, r: (u, r, 1),
        lambda u, r: (1, r, -u),
        lambda u, r: (-u, 1, r),
    ]
    side, heading = 8, 1.1
    strip = skybox([f.rgb for f in render_cube(compass(), HERE, side, heading=heading)])
    assert strip.shape == (side, 6 * side, 3)
    pose = camera_pose(HERE, heading)[:3, :3]
    for i, direction in enumerate(table):
        for row, column in ((0, 0), (1, 6), (7, 3)):
            u, r = (2 * (column + 0.5) / side - 1, 2 * (row + 0.5) / side - 1)
            d = pose @ np.array(direction(u, r), float)
            np.testing.assert_allclose(strip[row, i * side + column], d / np.linalg.norm(d), atol=1e-5)


def test_files_hold_what_was_drawn(tmp_path):
    r = np.random.default_rng(0)
    image = RenderOutput(
        r.uniform(-0.2, 1.2, (8, 16, 3)).astype(np.float32),
        r.uniform(0, 1, (8, 16)).astype(np.float32),
        r.uniform(0, 80, (8, 16)).astype(np.float32),
        r.uniform(-1, 1, (8, 16, 3)).astype(np.float32),
    )
    paths = write_panorama(tmp_path / "p.png", image)
    assert [p.name for p in paths] == ["p.png", "p_alpha.png", "p_depth.png", "p_normal.png"]
    rgb, alpha, depth, normal = (cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in paths)
    assert np.abs(rgb[..., ::-1] / 255 - np.clip(image.rgb, 0, 1)).max() < 0.003
    assert np.abs(alpha / 255 - image.alpha).max() < 0.003
    assert depth.dtype == np.uint16 and np.abs(depth / 1000 - np.minimum(image.depth, 65.535)).max() < 0.0006
    assert np.abs(normal[..., ::-1] / 127.5 - 1 - image.normal).max() < 0.005
    with pytest.raises(InputError, match="image file"):
        write_panorama(tmp_path / "p.xyz", image)


@pytest.mark.parametrize("channels", [frozenset({"rgb", "alpha", "normal"}), frozenset({"depth"})])
def test_the_wanted_part_of_a_panorama_is_that_of_the_whole(channels):
    model, mask = sphere(3000), np.zeros((64, 128), bool)
    mask[20:60, 10:30], mask[40:44], mask[:3, 100] = True, True, True
    whole = render_equirectangular(model, HERE, 128, 64, channels)
    part = render_equirectangular(model, HERE, 128, 64, channels, mask=mask)
    for name in channels:
        np.testing.assert_array_equal(getattr(part, name)[mask], getattr(whole, name)[mask])
        assert not getattr(part, name)[~mask].any()


def test_wanted_regions_of_views_are_those_of_the_whole_views():
    model, cameras = sphere(3000), cube(HERE, 50)
    masks = [np.random.default_rng(i).uniform(size=(50, 50)) < 0.002 * i for i in range(6)]
    views = render_regions(model, cameras, masks, ALL)
    for camera, mask, view in zip(cameras, masks, views, strict=True):
        whole = render_model(model, camera, ALL)
        for name in ALL:
            np.testing.assert_array_equal(getattr(view, name)[mask], getattr(whole, name)[mask])
    with pytest.raises(ValueError, match="mask"):
        render_regions(model, cameras[:1], [np.ones((50, 49), bool)])


def test_the_benchmark_draws_every_kind_of_panorama():
    model, places = furnished_hall()
    figures = measure(model, places[:1], model.floor.height_at, rounds=1)
    assert all(figures[name] > 0 for name in figures if name.endswith("_ms"))
    assert 0.02 < figures["wanted_of_views"] < 0.1 < figures["wanted_of_equirectangular"] < 0.5
