"""Training examples: images with pixel labels, in files that can be read in part."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import make_folder, replacement_file
from nvsim.geometry.camera import Camera, level_of

UNKNOWN = 255
"""Floor label of pixels without a label."""
SIZE = 240, 320
"""Rows and columns of a stored example; swapped for upright examples."""
_NAMES = ("images", "floor", "normals", "cameras")


@dataclass(frozen=True, eq=False)
class Example:
    """An image with labels of its pixels.

    image    (H, W, 3) uint8 RGB
    floor    (H, W) uint8: 1 floor, 0 not floor, UNKNOWN
    normals  (H, W, 3) float32 unit vectors, world, toward the camera; zero if unknown
    """

    image: NDArray[np.uint8]
    floor: NDArray[np.uint8]
    normals: NDArray[np.float32]
    camera: Camera


def write_shard(path: Path, examples: Sequence[Example]) -> None:
    """Writes examples of one size into the folder `path`. The file done.json is written last and marks the shard as
    complete.

    images   (N, H, W, 3) uint8 RGB
    floor    (N, H, W) uint8
    normals  (N, H, W, 3) int8: normals in the frame of the leveled camera, times 127
    cameras  (N, 13) float32: fx, fy, cx, cy in pixels, and the rotation from the camera to that frame, row by row

    Raises InputError if the disk reports an error.
    """
    make_folder(path)
    if examples:
        _write(path, examples)
    with replacement_file(path / "done.json") as temporary:
        temporary.write_text(json.dumps({"examples": len(examples)}))


def _write(path: Path, examples: Sequence[Example]) -> None:
    levels = [level_of(e.camera) for e in examples]
    normals = [np.rint(e.normals @ level.T * 127).astype(np.int8) for e, level in zip(examples, levels)]
    arrays: dict[str, NDArray[Any]] = {
        "images": np.stack([e.image for e in examples]),
        "floor": np.stack([e.floor for e in examples]),
        "normals": np.stack(normals),
        "cameras": np.stack([_numbers(e.camera, level) for e, level in zip(examples, levels)]),
    }
    for name, array in arrays.items():
        with replacement_file(path / f"{name}.npy") as temporary, open(temporary, "wb") as file:
            np.save(file, array)


def is_complete_shard(path: Path) -> bool:
    """Whether the shard at `path` is complete."""
    return (path / "done.json").is_file()


def _numbers(camera: Camera, level: NDArray[np.float64]) -> NDArray[np.float32]:
    k = camera.intrinsics
    return np.array([k.fx, k.fy, k.cx, k.cy, *(level @ camera.rotation).ravel()], np.float32)


class Shards:
    """The examples of several shards, identified by the number of the shard and the number in the shard."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._arrays: list[dict[str, NDArray[Any]]] = [
            {name: np.load(path / f"{name}.npy", mmap_mode="r") for name in _NAMES} for path in paths
        ]
        self.upright = np.array([a["images"].shape[1] > a["images"].shape[2] for a in self._arrays], bool)

    def __len__(self) -> int:
        """The number of shards."""
        return len(self._arrays)

    def size(self, shard: int) -> int:
        """The number of examples in a shard."""
        return len(self._arrays[shard]["images"])

    def read(self, shard: int, number: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Image (H, W, 3), floor (H, W), normals (H, W, 3) and camera (13,) of an example, as `write_shard` stores
        them."""
        image, floor, normals, camera = (np.asarray(self._arrays[shard][name][number]) for name in _NAMES)
        return image, floor, normals, camera
