"""Read and score the novel views of a ground truth: images away from the trajectory and with other headings, with poses
and, if known, floor masks.

FOLDER/holdout_frames.txt   "# PINHOLE width height fx F fy F cx C cy C", then a line per view: its image and the
                            16 numbers of the row-major camera-to-world pose (OpenCV axes, frame of the capture)
FOLDER/novel/NAME.png       the images
FOLDER/novel_floor/NAME.png true floor masks, 255 on floor; may be missing
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import to_aligned_frame
from nvsim.capture.images import decode
from nvsim.capture.types import Alignment
from nvsim.errors import InputError
from nvsim.evaluation.scores import LEAST_PIXELS, Scores, psnr
from nvsim.files.opening import is_regular, read_text
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.perception.segment import read_mask

LISTING = "holdout_frames.txt"
_LONGEST = 64 << 20  # bytes of the listing
STEEP = -0.35
"""Largest z of a unit ray direction that counts as steeply down, about 20 degrees below the horizon."""
_PINHOLE = re.compile(r"#\s*PINHOLE\s+(\d+)\s+(\d+)\s+fx\s+(\S+)\s+fy\s+(\S+)\s+cx\s+(\S+)\s+cy\s+(\S+)")


@dataclass(frozen=True, eq=False)
class NovelView:
    """name without folder and suffix; camera in the aligned frame; floor: mask file, None if there is none."""

    name: str
    camera: Camera
    picture: Path
    floor: Path | None

    def image(self) -> NDArray[np.float32]:
        """(H, W, 3) float32, 0 to 1. Raises InputError if the image cannot be read or has another size."""
        image = decode(self.picture)
        k = self.camera.intrinsics
        if image.shape[:2] != (k.height, k.width):
            raise InputError(
                f"{self.picture} has {image.shape[1]}x{image.shape[0]} pixels but {LISTING} says {k.width}x{k.height}; "
                "render it again at that size."
            )
        return (image / np.float32(255)).astype(np.float32)

    def floor_mask(self) -> NDArray[np.bool_] | None:
        """(H, W) bool, the true floor mask, None if there is none."""
        k = self.camera.intrinsics
        return None if self.floor is None else read_mask(self.floor, k.width, k.height)


def has_novel_views(folder: Path | None) -> bool:
    return folder is not None and (folder / LISTING).is_file()


def read_novel_views(folder: Path, alignment: Alignment) -> list[NovelView]:
    """The views in the order of the file, in the aligned frame. Raises InputError naming file and line."""
    path = folder / LISTING
    if not os.path.lexists(path):
        raise InputError(
            f"{path} is missing, so there are no novel views; name a ground truth that has them with --truth DIR."
        )
    intrinsics: Intrinsics | None = None
    views: list[NovelView] = []
    text = read_text(path, "a list of novel views", "write it again", _LONGEST)
    for number, line in enumerate(text.splitlines(), 1):
        found = _PINHOLE.match(line)
        try:
            if found:
                width, height = int(found[1]), int(found[2])
                fx, fy, cx, cy = (float(found[i]) for i in range(3, 7))
                intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
            if not line.strip() or line.startswith("#"):
                continue
            name, *numbers = line.split()
            pose = np.array([float(n) for n in numbers]).reshape(4, 4)
        except ValueError as error:
            raise InputError(
                f"{path}, line {number}, is not the name of an image and the 16 numbers of its pose; correct the line."
            ) from error
        if intrinsics is None:
            raise InputError(f"{path} names views before a line '# PINHOLE width height fx F fy F cx C cy C'; add it.")
        picture = folder / name
        mask = folder / "novel_floor" / f"{picture.stem}.png"
        camera = Camera(intrinsics, aligned_pose(pose, alignment))
        views.append(NovelView(picture.stem, camera, picture, mask if is_regular(mask) else None))
    return views


def aligned_pose(pose: NDArray[np.float64], alignment: Alignment) -> NDArray[np.float64]:
    """A camera-to-world pose (4, 4) of the capture's own frame, converted to the aligned frame."""
    result = np.eye(4)
    result[:3, :3] = alignment.rotation @ pose[:3, :3]
    result[:3, 3] = to_aligned_frame(pose[:3, 3], alignment)
    return result


def novel_score(
    view: NovelView, image: NDArray[np.float32], rendered: NDArray[np.float32], alpha: NDArray[np.float32]
) -> Scores:
    """Metrics of a render: image and rendered (H, W, 3), alpha (H, W), float32.

    novel_psnr is over the whole image, novel_psnr_down over rays that point steeply down, both in dB. novel_alpha_floor
    is the mean alpha on the true floor, NaN without a floor mask or with too few floor pixels."""
    error = ((image - np.clip(rendered, 0, 1)) ** 2).mean(axis=2)
    down = view.camera.rays()[..., 2] < STEEP
    floor = view.floor_mask()
    return {
        "novel_psnr": psnr(float(error.mean())),
        "novel_psnr_down": psnr(float(error[down].mean())) if down.any() else np.nan,
        "novel_alpha_floor": np.nan if floor is None or floor.sum() < LEAST_PIXELS else float(alpha[floor].mean()),
    }
