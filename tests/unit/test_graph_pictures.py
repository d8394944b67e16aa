"""The images beside a connectivity file as panoramas: each direction shows the right part of the world."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import cube, skybox
from nvsim.graph.foreign import ForeignFile

JPEG = [cv2.IMWRITE_JPEG_QUALITY, 100, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


def opened(tmp_path: Path, text: str) -> ForeignFile:
    path = tmp_path / "house_connectivity.json"
    path.write_text(text)
    return ForeignFile.open(path)


def world_colors(directions: np.ndarray) -> np.ndarray:
    """Of world directions (..., 3): what a picture would show of a sky whose color says where one looks."""
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.round(127.5 + 120 * unit).astype(np.uint8)


def picture_of(camera: Camera) -> np.ndarray:
    k = camera.intrinsics
    u, v = np.meshgrid(np.arange(k.width) + 0.5 - k.cx, np.arange(k.height) + 0.5 - k.cy)
    return world_colors(np.stack([u / k.fx, v / k.fy, np.ones_like(u)], axis=-1) @ camera.rotation.T)


def entry_looking(heading: float, id: str = "a" * 32) -> dict:
    """One whose pose looks along `heading`, level."""
    s, c = float(np.sin(heading)), float(np.cos(heading))
    pose = [c, 0, s, 0, -s, 0, c, 0, 0, -1, 0, 1.5, 0, 0, 0, 1]
    return {"image_id": id, "pose": pose, "included": True, "visible": [False], "unobstructed": [False], "height": 1.5}


@pytest.mark.parametrize("kind", ["strip", "faces", "views"])
def test_the_pictures_of_a_viewpoint_become_a_panorama_of_the_world_around_it(tmp_path: Path, kind: str) -> None:
    heading = 0.7
    file = opened(tmp_path, json.dumps([entry_looking(heading)]))
    (id,) = file.graph.viewpoints
    folder = tmp_path / "house" if kind == "views" else tmp_path / "house" / "matterport_skybox_images"
    (folder / id).mkdir(parents=True)
    if kind == "views":
        for row in range(3):
            for k in range(12):
                pose = camera_pose(np.zeros(3), np.radians(30 * k), np.radians(30 * row - 30))
                camera = Camera(Intrinsics.from_fov(320, 240, 1.3127), pose)
                cv2.imwrite(str(folder / id / f"{12 * row + k}.jpg"), picture_of(camera), JPEG)
    else:
        strip = skybox([picture_of(camera) for camera in cube(np.zeros(3), 128, heading)])
        if kind == "strip":
            cv2.imwrite(str(folder / f"{id}_skybox_small.jpg"), strip, JPEG)
        else:
            for k in range(6):
                cv2.imwrite(str(folder / f"{id}_skybox{k}_sami.jpg"), strip[:, 128 * k : 128 * (k + 1)], JPEG)
    found = file.panorama(id, 512)
    assert found is not None and found.shape == (256, 512, 3)
    heading_of, elevation_of = np.meshgrid(
        (np.arange(512) + 0.5) / 512 * 2 * np.pi - np.pi, np.pi / 2 - (np.arange(256) + 0.5) / 256 * np.pi
    )
    flat = np.cos(elevation_of)
    rays = np.stack([np.sin(heading_of) * flat, np.cos(heading_of) * flat, np.sin(elevation_of)], axis=-1)
    looked = (np.abs(elevation_of) < np.radians(58)) | (kind != "views")
    error = np.abs(found.astype(int) - world_colors(rays))[looked].max(axis=-1)
    assert np.quantile(error, 0.99) <= 5, "the colours of the sky are where one looks at them"


def test_a_skybox_that_is_none_is_refused_with_its_size(tmp_path: Path) -> None:
    file = opened(tmp_path, json.dumps([entry_looking(0.0)]))
    (id,) = file.graph.viewpoints
    folder = tmp_path / "matterport_skybox_images"
    folder.mkdir()
    assert file.panorama(id, 64) is None
    cv2.imwrite(str(folder / f"{id}_skybox_small.jpg"), np.zeros((20, 90, 3), np.uint8))
    with pytest.raises(InputError, match="90 x 20 pixels"):
        opened(tmp_path, json.dumps([entry_looking(0.0)])).panorama(id, 64)
    (folder / f"{id}_skybox_small.jpg").write_bytes(b"none")
    with pytest.raises(InputError, match="not an image"):
        opened(tmp_path, json.dumps([entry_looking(0.0)])).panorama(id, 64)
