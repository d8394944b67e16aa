"""Examples that a network learns from: images with what is known of their pixels, in files that are read in part."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import make_folder, replacing
from nvsim.geometry.camera import Camera
from nvsim.geometry.level import level_of

UNKNOWN = 255
"""Of a floor label."""
SIZE = 240, 320
"""Rows and columns of a stored example; of an upright one the other way round."""
_NAMES = ("images", "floor", "normals", "cameras")


@dataclass(frozen=True, eq=False)
class Example:
    """image    (H, W, 3) uint8 RGB
    floor    (H, W) uint8: 1 floor, 0 none, UNKNOWN
    normals  (H, W, 3) float32 unit, world, towards the camera; zero where unknown
    """

    image: NDArray[np.uint8]
    floor: NDArray[np.uint8]
    normals: NDArray[np.float32]
    camera: Camera


def write_shard(path: Path, examples: Sequence[Example]) -> None:
    """Writes examples of one size into the folder `path`, whole or not at all: arrays of `_NAMES`, the normals as those
    of the camera turned level times 127, a camera as fx, fy, cx, cy and the nine numbers of its rotation to that frame.
    Raises InputError when the disk refuses."""
    make_folder(path)
    if examples:
        _write(path, examples)
    with replacing(path / "done.json") as temporary:
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
        with replacing(path / f"{name}.npy") as temporary, open(temporary, "wb") as file:
            np.save(file, array)


def is_whole(path: Path) -> bool:
    """Whether the shard at `path` was finished."""
    return (path / "done.json").is_file()


def _numbers(camera: Camera, level: NDArray[np.float64]) -> NDArray[np.float32]:
    k = camera.intrinsics
    return np.array([k.fx, k.fy, k.cx, k.cy, *(level @ camera.rotation).ravel()], np.float32)


class Shards:
    """The examples of many shards. An example is named by shard and number."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._arrays: list[dict[str, NDArray[Any]]] = [
            {name: np.load(path / f"{name}.npy", mmap_mode="r") for name in _NAMES} for path in paths
        ]
        self.upright = np.array([a["images"].shape[1] > a["images"].shape[2] for a in self._arrays], bool)

    def __len__(self) -> int:
        """Of shards."""
        return len(self._arrays)

    def size(self, shard: int) -> int:
        return len(self._arrays[shard]["images"])

    def read(self, shard: int, number: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Image, floor, normals and camera as `write_shard` has them."""
        image, floor, normals, camera = (np.asarray(self._arrays[shard][name][number]) for name in _NAMES)
        return image, floor, normals, camera
