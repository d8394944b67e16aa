"""A box room with noise on its walls, ray cast: captures whose images can be matched."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL = 320, 240, 220.0
SIZE = np.array([6.0, 4.0, 2.6])
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def walk(count: int = 36) -> np.ndarray:
    """(count, 4, 4) camera to world, OpenCV axes: once around the room, looking ahead, outward and a little down."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i, turn in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        yaw, pitch = turn + np.pi / 2 - 0.3 * np.sin(3 * turn), -0.3 + 0.1 * np.sin(5 * turn)
        ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        poses[i, :3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        poses[i, :3, 3] = [3 + 1.6 * np.cos(turn), 2 + 0.9 * np.sin(turn), 1.4 + 0.1 * np.sin(4 * turn)]
    return poses


@functools.cache
def wall_texture(wall: int) -> np.ndarray:
    """(520, 800, 3) uint8."""
    noise = np.random.default_rng(wall).random((26, 40, 3)) * 200 + 30
    return cv2.resize(noise.astype(np.uint8), (800, 520), interpolation=cv2.INTER_CUBIC)


def render(pose: np.ndarray) -> np.ndarray:
    """(HEIGHT, WIDTH, 3) uint8."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    return seen(pose, np.stack([u / FOCAL, v / FOCAL, np.ones_like(u)], axis=-1))


def render_panorama(pose: np.ndarray, height: int = 256) -> np.ndarray:
    """(height, 2 * height, 3) uint8, equirectangular."""
    longitude, latitude = np.meshgrid(
        (np.arange(2 * height) + 0.5) / height * np.pi - np.pi, np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    )
    flat = np.cos(latitude)
    return seen(pose, np.stack([flat * np.sin(longitude), -np.sin(latitude), flat * np.cos(longitude)], axis=-1))


def seen(pose: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 along rays (H, W, 3) of a camera with OpenCV axes."""
    rays = rays @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        reach = np.where(rays > 0, SIZE - pose[:3, 3], -pose[:3, 3]) / rays
    wall = reach.argmin(axis=-1)
    hit = pose[:3, 3] + rays * reach.min(axis=-1)[..., None]
    image = np.zeros(rays.shape, np.uint8)
    for axis in range(3):
        for side in (0, 1):
            texture = wall_texture(2 * axis + side)
            rows = (wall == axis) & ((rays[..., axis] > 0) == bool(side))
            a, b = (np.clip(hit[rows][:, k] / 6 * 799, 0, 519).astype(int) for k in range(3) if k != axis)
            image[rows] = texture[b, a]
    return image


def write_images(folder: Path, poses: np.ndarray) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{i:03d}.png" for i in range(len(poses))]
    for path, pose in zip(paths, poses, strict=True):
        assert cv2.imwrite(str(path), render(pose))
    return paths


def write_capture(folder: Path, images: list[Path], poses: np.ndarray, **lens: float) -> Path:
    """A transforms.json without a cloud that lists `images` where they are, with poses in OpenCV axes."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = [
        {"file_path": str(image), "transform_matrix": (pose @ OPENGL).tolist()}
        for image, pose in zip(images, poses, strict=True)
    ]
    own = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT, **lens}
    path = folder / "transforms.json"
    path.write_text(json.dumps({"camera_model": "OPENCV", **own, "frames": frames}))
    return path
