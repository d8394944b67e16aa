"""Views out of skyboxes show what lies in each direction, as far as the strips are whole."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import face_axes, face_rays
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator.compiled_drawing import draw_colors, draw_depth
from nvsim.r2r.simulator.images import StripCache, rays_of
from nvsim.r2r.simulator.scan import CANONICAL


def opened(folder: Path, depth: bool = False) -> Simulator:
    sim = Simulator()
    sim.setNavGraphPath(folder / "connectivity")
    sim.setDatasetPath(folder / "scans")
    sim.setCameraResolution(96, 64)
    sim.setCameraVFOV(math.radians(60))
    sim.setElevationLimits(-1.5, 1.5)
    sim.setDepthEnabled(depth)
    return sim


def camera(heading: float, elevation: float, width: int = 96, height: int = 64) -> Camera:
    focal = height / 2 / math.tan(math.radians(30))
    k = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    return Camera(k, camera_pose(np.zeros(3), heading, elevation))


def sampled(strip: NDArray[np.uint8], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """The slow way: each ray by the table of the faces, bilinear, clamped to the face."""
    side, axes = len(strip), face_axes()
    out = np.zeros((*rays.shape[:2], 3))
    for row, column in np.ndindex(rays.shape[:2]):
        local = rays[row, column] @ axes
        face = int(np.argmax(local[:, 2]))
        u, v = np.clip((local[face, :2] / local[face, 2] + 1) / 2 * side - 0.5, 0, side - 1)
        a, b = int(u), int(v)
        c, d = min(a + 1, side - 1), min(b + 1, side - 1)
        f, g = u - a, v - b
        pixels = strip[:, face * side : (face + 1) * side].astype(float)
        top, bottom = pixels[b, a] * (1 - f) + pixels[b, c] * f, pixels[d, a] * (1 - f) + pixels[d, c] * f
        out[row, column] = top * (1 - g) + bottom * g
    return out


@pytest.mark.parametrize(("heading", "elevation"), [(0.0, 0.0), (0.8, 0.3), (2.4, -1.2), (3.9, 1.4), (5.5, -0.5)])
def test_colors_are_those_of_the_slow_way(heading: float, elevation: float) -> None:
    strip = np.random.default_rng(0).integers(0, 256, (32, 192, 3)).astype(np.uint8)
    rotation = camera_pose(np.zeros(3), 1.1, 0.2)[:3, :3]
    out = np.zeros((64, 96, 3), np.uint8)
    draw_colors(strip, rays_of(rotation, heading, elevation, 96, 64, math.radians(60))[0], out)
    expected = sampled(strip, camera(heading, elevation).rays().astype(float) @ rotation)
    assert np.abs(out - expected).max() < 3  # weights are of 1/256, pixels are noise
    assert np.abs(out - expected).mean() < 0.6


def test_a_level_pose_that_faces_y_shows_its_front_face_at_heading_0_and_its_right_face_at_90_degrees() -> None:
    strip = np.repeat(np.arange(6, dtype=np.uint8) * 40, 16)[None, :, None].repeat(16, 0).repeat(3, 2)
    out = np.zeros((8, 8, 3), np.uint8)
    for heading, elevation, face in ((0, 0, 3), (90, 0, 4), (180, 0, 1), (270, 0, 2), (0, 90, 0), (0, -90, 5)):
        rays, _ = rays_of(CANONICAL, math.radians(heading), math.radians(elevation), 8, 8, math.radians(60))
        draw_colors(np.ascontiguousarray(strip), rays, out)
        assert (out == face * 40).all()


def test_depth_is_along_the_axis_where_the_strip_is_the_distance() -> None:
    """A room of 4 x 6 x 3 meters seen from off its middle: the closed form of its walls."""
    low, high, eye = np.array([0, 0, 0.0]), np.array([4, 6, 3.0]), np.array([1.5, 2.5, 1.2])

    def distance(rays: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(divide="ignore"):
            return np.where(rays > 0, (high - eye) / rays, (low - eye) / rays).min(axis=-1)

    rays = face_rays(256) @ CANONICAL.T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    strip = np.concatenate(list((4000 * distance(rays)).round().astype(np.uint16)), axis=1)
    for heading, elevation in ((0.0, 0.0), (0.7, -0.4), (2.5, 0.9)):
        view, plane = rays_of(CANONICAL, heading, elevation, 96, 64, math.radians(60))
        out = np.zeros((64, 96, 1), np.uint16)
        draw_depth(strip, view, plane, out)
        seen = camera(heading, elevation)
        expected = 4000 * distance(seen.rays().astype(float)) * (seen.rays() @ seen.rotation[:, 2])
        assert np.abs(out[..., 0] - expected).max() < 0.02 * expected.max()
        assert np.median(np.abs(out[..., 0] - expected)) < 40  # a centimeter: the nearest pixel's


def test_a_view_shows_the_colors_that_its_directions_have(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=6, side=128)
    sim = opened(tmp_path, depth=True)
    for id, heading, elevation in zip(ids, (0.0, 1.3, 2.9, 4.4, 5.9), (0.0, 0.5, -1.1, 1.3, -0.2), strict=False):
        sim.newEpisode(["made"], [id], [heading], [elevation])
        state = sim.getState()[0]
        rays = camera(heading, elevation).rays()
        waves = np.stack([np.sin(9 * rays[..., a] + 4 * rays[..., (a + 1) % 3]) for a in range(3)], axis=-1)
        assert np.abs(state.rgb - (128 + 40 * rays + 40 * waves)).max() < 14
        z = rays @ camera(heading, elevation).rotation[:, 2]
        assert np.abs(state.depth[..., 0] / 4000 - (3 + waves[..., 0]) * z).max() < 0.15
        assert np.array(state.rgb, copy=False).dtype == np.uint8


def test_an_image_that_was_kept_stays_as_it_is(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=4, side=32)
    sim = opened(tmp_path)
    sim.newEpisode("made", ids[0], 0, 0)
    kept = sim.getState().rgb
    before = kept.copy()
    sim.makeAction(0, 1.5, 0)
    assert (kept == before).all() and not (sim.getState().rgb == before).all()


def test_strips_that_cannot_be_used_are_refused_and_the_state_stays(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=4, side=64, plain=True)
    folder = tmp_path / "scans" / "made" / "matterport_skybox_images"
    path, depth = folder / f"{ids[1]}_skybox_small.jpg", folder / f"{ids[1]}_skybox_depth_small.png"
    good, good_depth = path.read_bytes(), depth.read_bytes()
    sim = opened(tmp_path, depth=True)
    sim.newEpisode("made", ids[0], 0, 0)

    def jpeg(width: int, height: int) -> bytes:
        return cv2.imencode(".jpg", np.zeros((height, width, 3), np.uint8))[1].tobytes()

    def png(image: NDArray[np.generic]) -> bytes:
        return cv2.imencode(".png", np.asarray(image))[1].tobytes()

    for data, words in (
        (good[: len(good) // 2], "is truncated"),
        (jpeg(6 * 64, 80), "384x80 pixels, but a skybox is six square faces"),
        (jpeg(605, 100), "six square faces"),
        (b"nothing", "not a skybox that can be decoded"),
    ):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=words):
            sim.newEpisode("made", ids[1], 0, 0)
        assert sim.getState().location.viewpointId == ids[0]
    path.unlink()
    with pytest.raises(ValueError, match=f"Could not open skybox RGB files at: .*{ids[1]}_skybox_small.jpg"):
        sim.newEpisode("made", ids[1], 0, 0)
    path.write_bytes(good)
    for data, words in (
        (png(np.zeros((64, 384), np.uint8)), "16 bits"),
        (good_depth[: len(good_depth) // 2], "."),
    ):
        depth.write_bytes(data)
        with pytest.raises(ValueError, match=words):
            sim.newEpisode("made", ids[1], 0, 0)
    depth.unlink()
    with pytest.raises(ValueError, match="Could not open skybox depth files"):
        sim.newEpisode("made", ids[1], 0, 0)


def test_six_images_of_faces_stand_in_for_a_strip(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=2, side=32, plain=True)
    sim = opened(tmp_path)
    sim.newEpisode("made", ids[0], 1.0, 0.3)
    before = sim.getState().rgb
    folder = tmp_path / "scans" / "made" / "matterport_skybox_images"
    strip = folder / f"{ids[0]}_skybox_small.jpg"
    image = cv2.imread(str(strip))
    strip.unlink()
    for k in range(6):
        face = image[:, 32 * k : 32 * (k + 1)]
        data = cv2.imencode(".jpg", face, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
        (folder / f"{ids[0]}_skybox{k}_sami.jpg").write_bytes(data)
    other = opened(tmp_path)
    other.newEpisode("made", ids[0], 1.0, 0.3)
    assert np.abs(other.getState().rgb.astype(int) - before).mean() < 2


def test_no_more_strips_are_kept_than_the_cache_holds(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=6, side=16, plain=True)
    cache = StripCache(tmp_path / "scans", 3)
    for id in ids:
        cache.colors("made", id)
    assert len(cache) == 3
    first = cache.colors("made", ids[-3])
    cache.colors("made", ids[0])
    assert cache.colors("made", ids[-3]) is first  # used last but one, so it stayed


def test_preloading_reads_every_image_that_is_included_at_once(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=5, side=16, plain=True)
    path = tmp_path / "connectivity" / "made_connectivity.json"
    entries = json.loads(path.read_text())
    entries[0]["included"] = False
    path.write_text(json.dumps(entries))
    folder = tmp_path / "scans" / "made" / "matterport_skybox_images"
    (folder / f"{ids[0]}_skybox_small.jpg").unlink()
    sim = opened(tmp_path)
    sim.setPreloadingEnabled(True)
    sim.initialize()
    for image in folder.glob("*.jpg"):
        image.unlink()
    sim.newEpisode("made", ids[2], 0, 0)
    assert sim.getState().rgb.any()


def test_a_strip_that_was_written_again_is_seen_by_a_new_simulator(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=2, side=16, plain=True)
    sim = opened(tmp_path)
    sim.newEpisode("made", ids[0], 0, 0)
    path = tmp_path / "scans" / "made" / "matterport_skybox_images" / f"{ids[0]}_skybox_small.jpg"
    path.write_bytes(cv2.imencode(".jpg", np.full((16, 96, 3), 200, np.uint8))[1].tobytes())
    other = opened(tmp_path)
    other.newEpisode("made", ids[0], 0, 0)
    assert np.abs(other.getState().rgb.astype(int) - 200).max() < 3
