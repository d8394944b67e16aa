"""PlayCanvas's SOG, version 2: attributes as lossless WebP images of bytes, some of them indices into codebooks, and a
meta.json; in a zip archive or a folder."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.splats.formats.library import finite
from nvsim.splats.types import Gaussians

Bytes = NDArray[np.uint8]
LARGEST_FILE = 1 << 30
"""Bytes of one file of the archive, unpacked."""
_COEFFICIENTS = {1: 3, 2: 8, 3: 15}
_PER_ROW = 64
_FIRST_TAG = 252


def read_sog(path: Path) -> Gaussians:
    """`path` is the archive or the meta.json of a folder. Raises InputError naming the file and the part of it that is
    missing or wrong."""
    if path.name == "meta.json":
        return _read(path, lambda name: _from_folder(path.parent, name))
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(path, lambda name: _from_archive(path, archive, name))
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError) as error:
        raise InputError(f"{path} is a damaged archive ({error}); copy it again.") from error


def _read(path: Path, load: Callable[[str], bytes]) -> Gaussians:
    try:
        meta = json.loads(load("meta.json"))
        if meta.get("version") != 2:
            raise InputError(f"{path} is SOG version {meta.get('version', 1)}; export it as version 2.")
        count = int(meta["count"])
        return finite(path, _decoded(path, meta, count, load))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(
            f"{path} has a meta.json that does not describe a SOG ({error!r}); export it again."
        ) from error


def _decoded(path: Path, meta: dict[str, Any], count: int, load: Callable[[str], bytes]) -> Gaussians:
    def pixels(part: str, index: int = 0) -> Bytes:
        return _pixels(path, meta[part]["files"][index], count, load)

    def looked_up(part: str, indices: Bytes) -> NDArray[np.float32]:
        codebook = np.asarray(meta[part]["codebook"], np.float32)
        if codebook.shape != (256,):
            raise InputError(f"{path}: the codebook of {part} has {codebook.size} entries, not 256; export it again.")
        return np.asarray(codebook[indices], np.float32)

    low, high = (np.asarray(meta["means"][k], np.float64).reshape(3) for k in ("mins", "maxs"))
    share = (pixels("means", 0)[:, :3] + 256.0 * pixels("means", 1)[:, :3]) / 65535
    logarithms = low + (high - low) * share
    colours = pixels("sh0")
    opacity = np.clip(colours[:, 3] / 255, 0.5 / 255, 1 - 0.5 / 255)
    sh = looked_up("sh0", colours[:, :3])[:, None]
    if "shN" in meta:
        sh = np.concatenate([sh, _higher(path, meta["shN"], count, load)], axis=1)
    return Gaussians(
        (np.sign(logarithms) * np.expm1(np.abs(logarithms))).astype(np.float32),
        np.ascontiguousarray(looked_up("scales", pixels("scales")[:, :3])),
        _rotations(path, pixels("quats")),
        np.log(opacity / (1 - opacity)).astype(np.float32),
        np.ascontiguousarray(sh, np.float32),
    )


def _rotations(path: Path, pixels: Bytes) -> NDArray[np.float32]:
    """Three components of w x y z by the square root of two; the tag tells which one, the largest, is left out."""
    left_out = pixels[:, 3].astype(np.int64) - _FIRST_TAG
    if (left_out < 0).any():
        raise InputError(f"{path} has rotations of an unknown kind; export it again.")
    three = (pixels[:, :3] / 255 * 2 - 1) / np.sqrt(2)
    quats = np.empty((len(pixels), 4))
    rows = np.arange(len(pixels))
    for k in range(3):
        quats[rows, k + (k >= left_out)] = three[:, k]
    quats[rows, left_out] = np.sqrt(np.maximum(1 - (three**2).sum(axis=1), 0))
    return quats.astype(np.float32)


def _higher(path: Path, meta: dict[str, Any], count: int, load: Callable[[str], bytes]) -> NDArray[np.float32]:
    """(count, K, 3): every Gaussian names one of the palette's sets of coefficients, 64 sets to a row of pixels."""
    coefficients, entries = _COEFFICIENTS[int(meta["bands"])], int(meta["count"])
    codebook = np.asarray(meta["codebook"], np.float32)
    labels = _pixels(path, meta["files"][1], count, load)[:, :2].astype(np.int64) @ np.array([1, 256])
    picture = _image(path, meta["files"][0], load)[..., :3]
    if picture.shape[1] != _PER_ROW * coefficients or labels.max(initial=0) >= min(entries, _PER_ROW * len(picture)):
        raise InputError(f"{path}: {meta['files'][0]} does not hold {entries} sets of coefficients; export it again.")
    palette = picture.reshape(-1, coefficients, 3)
    return np.asarray(codebook[palette[labels]], np.float32)


def _pixels(path: Path, name: str, count: int, load: Callable[[str], bytes]) -> Bytes:
    """The first `count` pixels, (count, 4)."""
    flat = _image(path, name, load).reshape(-1, 4)
    if not 0 < count <= len(flat):
        raise InputError(f"{path}: {name} has {len(flat)} pixels for {count} Gaussians; export it again.")
    return flat[:count]


def _image(path: Path, name: str, load: Callable[[str], bytes]) -> Bytes:
    decoded = cv2.imdecode(np.frombuffer(load(name), np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None or decoded.ndim != 3 or decoded.dtype != np.uint8:
        raise InputError(f"{path}: {name} is no colour image; copy it again.")
    if decoded.shape[2] == 3:
        decoded = np.dstack([decoded, np.full(decoded.shape[:2], 255, np.uint8)])
    return np.asarray(decoded[..., [2, 1, 0, 3]], np.uint8)


def _from_folder(folder: Path, name: str) -> bytes:
    try:
        return (folder / Path(name).name).read_bytes()
    except OSError as error:
        raise InputError(f"Cannot read {folder / name}: {error.strerror or error}; copy the folder again.") from error


def _from_archive(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        if archive.getinfo(name).file_size > LARGEST_FILE:
            raise InputError(f"{path}: {name} is larger than {LARGEST_FILE} bytes; this cannot be a SOG.")
        return archive.read(name)
    except KeyError as error:
        raise InputError(f"{path} has no {name}; copy it again.") from error
