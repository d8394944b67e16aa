"""A video of the textured room along a known path, with its true poses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from textured_room import HEIGHT, WIDTH, render


def filmed_path(count: int = 30) -> np.ndarray:
    """(count, 4, 4) camera to world, OpenCV axes: along a wall, turning past it."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for pose, t in zip(poses, np.linspace(0.1, 0.85, count), strict=True):
        yaw, pitch = np.pi / 2 + 0.7 - 1.4 * t, -0.15
        ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        pose[:3, 3] = [1.2 + 3.4 * t, 1.0 + 0.5 * np.sin(6 * t), 1.4 + 0.1 * np.sin(9 * t)]
    return poses


def write_video(path: Path, poses: np.ndarray | None = None) -> Path:
    """An MP4 with 10 frames per second, one for each pose."""
    path.parent.mkdir(parents=True, exist_ok=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (WIDTH, HEIGHT))
    for pose in filmed_path() if poses is None else poses:
        video.write(render(pose))
    video.release()
    assert path.stat().st_size > 0
    return path
