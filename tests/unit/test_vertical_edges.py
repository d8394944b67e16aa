"""The vertical from edges in images of posts whose directions are known."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.capture.raw import RawFrame
from nvsim.capture.types import MaskFile
from nvsim.capture.vertical_edges import vertical_from_images
from nvsim.geometry.lens import Lens

WIDTH, HEIGHT, FOCAL = 320, 240, 160.0
UP = np.array([0.0, 0.0, 1.0])
LEANING = np.array([0.0, np.sin(np.radians(5.0)), np.cos(np.radians(5.0))])


def _images(folder: Path, masked: bool) -> list[RawFrame]:
    """Eight images in all directions: three vertical posts in the left third and six leaning posts beside them, which
    a mask ignores."""
    lens = Lens("PINHOLE", WIDTH, HEIGHT, (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2))
    frames = []
    for i, yaw in enumerate(np.arange(8) * np.pi / 4):
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        rotation = np.stack([np.cross(ahead, UP), -UP, ahead], axis=1)
        image = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
        for column in (20, 50, 80, 130, 160, 190, 220, 250, 280):
            middle = rotation @ [(column - WIDTH / 2) / FOCAL, 0.0, 1.0]
            ends = [(middle + s * (UP if column < 100 else LEANING)) @ rotation for s in (-0.5, 0.5)]
            pixels = [FOCAL * end[:2] / end[2] + [WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5] for end in ends]
            a, b = np.rint(16 * np.array(pixels)).astype(int).tolist()  # in sixteenths of a pixel
            cv2.line(image, a, b, (220, 220, 220), 3, cv2.LINE_AA, shift=4)
        path, mask = folder / f"{i}.png", folder / f"{i}.mask.png"
        cv2.imwrite(str(path), image)
        cv2.imwrite(str(mask), np.tile(np.where(np.arange(WIDTH) < 105, 255, 0).astype(np.uint8), (HEIGHT, 1)))
        pose = np.eye(4)
        pose[:3, :3] = rotation
        frames.append(RawFrame(path.name, path, lens, pose, "", mask=MaskFile(mask) if masked else None))
    return frames


def _degrees(found: NDArray[np.float64] | None, direction: NDArray[np.float64]) -> float:
    assert found is not None
    return float(np.degrees(np.arccos(np.clip(found @ direction, -1, 1))))


@pytest.mark.parametrize(("masked", "direction"), [(True, UP), (False, LEANING)])
def test_edges_in_ignored_pixels_do_not_count(masked: bool, direction: NDArray[np.float64], tmp_path: Path) -> None:
    assert _degrees(vertical_from_images(_images(tmp_path, masked), LEANING), direction) < 0.3


def test_images_that_cannot_be_read_are_skipped(tmp_path: Path) -> None:
    frames = _images(tmp_path, True)
    frames[0].image_path.unlink()
    assert _degrees(vertical_from_images(frames, UP), UP) < 0.3
    for frame in frames[1:]:
        frame.image_path.write_bytes(b"no image")
    assert vertical_from_images(frames, UP) is None
