"""Videos of a textured plane that a known homography moves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 320, 240


def texture(seed: int = 0, width: int = 900, height: int = 500) -> NDArray[np.uint8]:
    """(height, width) smooth noise in two sizes."""
    rng = np.random.default_rng(seed)
    sizes = ((8, 100.0), (24, 100.0))
    layers = [
        cv2.resize(rng.random((height // n, width // n)) * weight, (width, height), interpolation=cv2.INTER_CUBIC)
        for n, weight in sizes
    ]
    return np.asarray(np.clip(sum(layers) + 20, 0, 255), np.uint8)


def view(plane: NDArray[np.uint8], image_from_plane: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(HEIGHT, WIDTH) of the plane, pixel (0, 0) at its center."""
    return np.asarray(cv2.warpPerspective(plane, image_from_plane, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC), np.uint8)


def shifted(x: float, y: float = 0.0) -> NDArray[np.float64]:
    """Shows the plane from (x, y) on."""
    return np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])


def blurred(image: NDArray[np.uint8], length: int = 41) -> NDArray[np.uint8]:
    """Smeared in both directions."""
    return np.asarray(cv2.blur(image, (length, length)), np.uint8)


def colored(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), np.uint8)


def write_video(path: Path, images: list[NDArray[np.uint8]], rate: float = 10.0) -> Path:
    """Gray images as a Motion JPEG video."""
    height, width = images[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (width, height))
    assert writer.isOpened()
    for image in images:
        writer.write(colored(image))
    writer.release()
    return path
