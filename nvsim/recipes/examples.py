"""Training examples: images with pixel labels, in files that can be read in part; and batches of random crops of them,
mirrored, and degraded like images of bad cameras and small files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
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


MEAN, STD = 127.0, 128.0
"""Mean and scale of gray levels (0 to 255) for the input of the trunk."""
CUT = 192, 256
"""Rows and columns of a training crop; swapped for upright examples."""
Array = NDArray[Any]


class Batch(NamedTuple):
    """N examples of one size as float32 arrays, in the form that `network.loss` takes: images and rays (N, 3, H, W),
    floor and known (N, H, W), normals (N, 3, H, W)."""

    images: Array
    rays: Array
    floor: Array
    normals: Array
    known: Array


def batch(shards: Shards, shares: Sequence[float], count: int, rng: np.random.Generator) -> Batch:
    """Draws `count` examples from shards with probabilities proportional to `shares`; all are upright or none is."""
    chances = np.array(shares, float)
    upright = bool(shards.upright[rng.choice(len(shards), p=chances / chances.sum())])
    chances[shards.upright != upright] = 0
    drawn = rng.choice(len(shards), count, p=chances / chances.sum())
    size = CUT[::-1] if upright else CUT
    cuts = [_cut(*shards.read(int(s), int(rng.integers(shards.size(int(s))))), size, rng) for s in drawn]
    return Batch(*(np.ascontiguousarray(np.stack(part), np.float32) for part in zip(*cuts)))


def _cut(
    image: Array, floor: Array, normals: Array, camera: Array, size: tuple[int, int], rng: np.random.Generator
) -> tuple[Array, ...]:
    rows, columns = size
    height, width = floor.shape
    share = rng.uniform(0.4, 1.0)
    h, w = share * height, min(width, share * width * rng.uniform(0.85, 1.15))
    top, left = rng.uniform(0, height - h), rng.uniform(0, width - w)
    x = left + (np.arange(columns) + 0.5) * w / columns
    y = top + (np.arange(rows) + 0.5) * h / rows
    nearest = np.ix_(np.minimum(y.astype(int), height - 1), np.minimum(x.astype(int), width - 1))
    u, v = np.meshgrid((x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32))
    image = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    floor, found = floor[nearest], normals[nearest].astype(np.float32) / 127
    rays = _rays(camera, x, y, rng)
    if rng.random() < 0.5:
        image, floor, found, rays = image[:, ::-1], floor[:, ::-1], found[:, ::-1].copy(), rays[:, ::-1].copy()
        found[..., 0] *= -1
        rays[..., 0] *= -1
    image = degrade_image(np.ascontiguousarray(image), rng)
    known = floor != UNKNOWN
    return (
        (image.astype(np.float32).transpose(2, 0, 1) - MEAN) / STD, rays.transpose(2, 0, 1), (floor == 1),
        found.transpose(2, 0, 1), known,
    )  # fmt: skip


def _rays(camera: Array, x: Array, y: Array, rng: np.random.Generator) -> Array:
    """(H, W, 3) float32 unit rays at columns `x` and rows `y`, with a random tilt error of about one degree."""
    fx, fy, cx, cy = camera[:4]
    local = np.stack(np.broadcast_arrays((x[None, :] - cx) / fx, (y[:, None] - cy) / fy, np.float32(1)), -1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    pitch, roll = np.radians(rng.normal(0, 1.0, 2))
    tilt = np.array([[1, -roll, 0], [roll, 1, -pitch], [0, pitch, 1]])
    return np.asarray(local @ (tilt @ camera[4:].reshape(3, 3)).T, np.float32)


def degrade_image(image: Array, rng: np.random.Generator) -> Array:
    """Degrades an image (H, W, 3) uint8 by random light, camera and compression; returns (H, W, 3) uint8."""
    rows, columns = image.shape[:2]
    values: Array = image.astype(np.float32) / 255
    if rng.random() < 0.12:
        values = _other_texture(values, rng)
    if rng.random() < 0.8:
        values = values ** np.float32(np.exp(rng.normal(0, 0.25)))
        values = values * np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.07, 3)).astype(np.float32)
        gray = values.mean(axis=2, keepdims=True)
        values = gray + (values - gray) * np.float32(rng.uniform(0.0, 1.5) if rng.random() < 0.6 else 1.0)
        values = (values - 0.45) * np.float32(rng.uniform(0.7, 1.3)) + np.float32(0.45)
    if rng.random() < 0.3:
        values = values[..., rng.permutation(3)]
    if rng.random() < 0.4:  # brightness that decreases across the image
        slope = rng.normal(0, 0.35, 2)
        field = np.linspace(-1, 1, rows)[:, None] * slope[0] + np.linspace(-1, 1, columns)[None, :] * slope[1]
        values = values * np.exp(field)[..., None].astype(np.float32)
    if rng.random() < 0.4:  # soft shadows and patches of light
        soft = rng.normal(0, rng.uniform(0.05, 0.35), (5, 6)).astype(np.float32)
        values = values * np.exp(cv2.resize(soft, (columns, rows), interpolation=cv2.INTER_CUBIC))[..., None]
    if rng.random() < 0.3:  # an enlarged small image
        factor = rng.uniform(0.33, 0.75)
        small = cv2.resize(values, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        values = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
    elif rng.random() < 0.35:
        values = cv2.GaussianBlur(values, (0, 0), rng.uniform(0.4, 2.0))
    elif rng.random() < 0.1:
        length = int(rng.integers(3, 10))
        values = cv2.blur(values, (length, 1) if rng.random() < 0.7 else (1, length))
    if rng.random() < 0.5:
        values = values + rng.normal(0, rng.uniform(0.004, 0.04), values.shape).astype(np.float32)
    found: Array = np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.35:
        quality = int(rng.integers(20, 90))
        encoded = cv2.imencode(".jpg", found, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        found = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR))
    return np.asarray(found, np.uint8)


def _other_texture(values: Array, rng: np.random.Generator) -> Array:
    """The image (H, W, 3), 0 to 1, mixed with itself after a random convolution: other colors and textures, the same
    shapes (Xu et al. 2021, Robust and Generalizable Visual Representation Learning via Random Convolutions)."""
    kernels = rng.normal(0, 27**-0.5, (3, 3, 3, 3)).astype(np.float32)
    mixed = np.stack([sum(cv2.filter2D(values[..., c], -1, k[c]) for c in range(3)) for k in kernels], axis=-1)
    low, spread = mixed.mean(axis=(0, 1)), mixed.std(axis=(0, 1)) + 1e-3
    share = np.float32(rng.uniform(0.2, 0.8))
    found: Array = np.clip(share * values + (1 - share) * (0.22 * (mixed - low) / spread + 0.5), 0, 1)
    return found
