"""Depth maps on disk: NNNNNN.png holds the depth along the optical axis in millimeters (16 bits, 0 = unknown), and
NNNNNN_confidence.png the number of other views that confirm it (8 bits)."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import write_bytes
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.files.stored_arrays import read_arrays

_AGAIN = "delete it and run `nvsim depth --project` again"


def depth_path(folder: Path, index: int) -> Path:
    """The path of the depth of frame `index`."""
    return folder / f"{index:06d}.png"


def confidence_path(folder: Path, index: int) -> Path:
    """The path of the confidence of frame `index`."""
    return folder / f"{index:06d}_confidence.png"


def write_depth(folder: Path, index: int, inverse: NDArray[np.float32], views: NDArray[np.uint8]) -> None:
    """Write inverse depth (H, W), 1 / meters, 0 where unknown, and the number of views (H, W) that confirm it.

    Depth beyond 65 m is stored as unknown. Raises InputError if the files cannot be written."""
    with np.errstate(divide="ignore"):
        depth = np.where(inverse > 1 / 65.0, np.rint(1000 / inverse), 0).astype(np.uint16)
    # Depth is written last: if it exists, the confidence exists too.
    write_bytes(confidence_path(folder, index), _png(np.where(depth > 0, views, 0).astype(np.uint8)))
    write_bytes(depth_path(folder, index), _png(depth))


def read_depth(folder: Path, index: int) -> NDArray[np.float32]:
    """(H, W) float32 depth in meters along the optical axis, 0 where unknown. Raises InputError if the file cannot be
    read."""
    path = depth_path(folder, index)
    stored = decode_pixels(read_bytes(path), path, cv2.IMREAD_UNCHANGED, what="a depth map", then=_AGAIN)
    return np.asarray(stored, np.float32).reshape(stored.shape[:2]) / np.float32(1000)


def read_confidence(folder: Path, index: int) -> NDArray[np.uint8]:
    """(H, W) uint8, number of other views that confirm the depth. Raises InputError if it cannot be read."""
    path = confidence_path(folder, index)
    return np.asarray(
        decode_pixels(read_bytes(path), path, cv2.IMREAD_GRAYSCALE, what="a confidence map", then=_AGAIN), np.uint8
    )


def draft_path(folder: Path, index: int) -> Path:
    """The path of the draft of frame `index`, which exists until the stage is done."""
    return folder / f"{index:06d}.npz"


def write_draft(folder: Path, index: int, inverse: NDArray[np.float32], weight: NDArray[np.float32]) -> None:
    """Store inverse depth (H, W), 1 / meters, and its inverse variance (H, W), meters squared, in half precision.

    Raises InputError if the file cannot be written."""
    held = io.BytesIO()
    root = np.minimum(np.sqrt(weight), 6e4)  # the largest half-precision float is 65504
    np.savez(held, inverse=inverse.astype(np.float16), sharpness=root.astype(np.float16))
    write_bytes(draft_path(folder, index), held.getvalue())


def read_draft(folder: Path, index: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Inverse depth (H, W) float32, 1 / meters, and inverse variance (H, W) float32, meters squared, that `write_draft`
    stored. Raises InputError if the file cannot be read."""
    path = draft_path(folder, index)
    arrays = read_arrays(path, "an unfinished depth map", {"inverse": ("f", 2), "sharpness": ("f", 2)}, _AGAIN)
    return arrays["inverse"].astype(np.float32), arrays["sharpness"].astype(np.float32) ** 2


def _png(values: NDArray[np.integer]) -> bytes:
    return bytes(cv2.imencode(".png", values, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
