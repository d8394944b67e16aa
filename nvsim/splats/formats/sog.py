"""Read PlayCanvas's SOG, version 2: a meta.json and lossless WebP images in a zip archive or a folder. The images store
attributes as bytes, some of them as indices into codebooks.

A streamed SOG has a lod-meta.json that names SOGs in folders. A tree of boxes says which of them have the Gaussians of
each level of detail. Level 0 is the finest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files.opening import parse_json, read_json
from nvsim.files.reading import reading
from nvsim.splats.formats.cleaning import ROWS, room_for
from nvsim.splats.formats.sog_files import META, Bytes, Files, from_archive, from_folder
from nvsim.splats.types import Gaussians

_WHAT, _THEN = "a meta.json of a SOG", "export it again"
_COEFFICIENTS = {1: 3, 2: 8, 3: 15}
_PER_ROW = 64
_MOST_ENTRIES = 1 << 16
_FIRST_TAG = 252
_ENTRIES = 256
_LONGEST_NAME = 200
Float = TypeVar("Float", bound=np.floating)


def read_sog(path: Path) -> Gaussians:
    """Reads the Gaussians of a SOG. `path` is an archive or the meta.json of a folder. Raises InputError naming the
    file and the missing or invalid part."""
    with (
        reading(path, "a SOG", "copy it again"),
        from_folder(path) if path.name == META else from_archive(path) as files,
    ):
        meta = parse_json(path, files.description(), _WHAT, _THEN)
        return _Reader(path, files, meta).gaussians()


class _Reader:
    """One SOG. Its images are decoded when they are needed, and at most two are in memory."""

    def __init__(self, path: Path, files: Files, meta: object) -> None:
        self._path, self._files = path, files
        if not isinstance(meta, Mapping):
            raise InputError(f"{path} has a meta.json that does not describe a SOG; {_THEN}.")
        version = meta.get("version", 1)
        if version != 2:
            raise InputError(f"{path} is SOG version {value_text(version)}; export it as version 2.")
        self._meta = meta
        self._count = self._number(meta, "count")
        self._names: list[str] = []

    def gaussians(self) -> Gaussians:
        higher = self._part("shN") if self._meta.get("shN") is not None else None
        bands = 0 if higher is None else self._number(higher, "bands")
        if higher is not None and bands not in _COEFFICIENTS:
            raise InputError(f"{self._path} has SH coefficients of {bands} bands; NVSim can read 1 to 3.")
        parts = ("means", "scales", "quats", "sh0", *(() if higher is None else ("shN",)))
        size = self._files.size([name for part in parts for name in self._part(part).get("files", ())])
        g = room_for(self._path, self._count, 1 + _COEFFICIENTS.get(bands, 0), size)
        self._means(g)
        book = self._codebook("scales")
        for rows, pixels in self._blocks(self._pixels("scales")):
            g.log_scales[rows] = book[pixels[:, :3]]
        for rows, pixels in self._blocks(self._pixels("quats")):
            g.quats[rows] = _rotations(self._path, pixels)
        book = self._codebook("sh0")
        for rows, pixels in self._blocks(self._pixels("sh0")):
            opacity = np.clip(pixels[:, 3] / 255, 0.5 / 255, 1 - 0.5 / 255)
            g.opacity_logits[rows] = np.log(opacity / (1 - opacity))
            g.sh[rows, 0] = book[pixels[:, :3]]
        if higher is not None:
            self._higher(g, higher, _COEFFICIENTS[bands])
        return g

    def _means(self, g: Gaussians) -> None:
        low, high = self._triple("mins"), self._triple("maxs")
        fine, coarse = self._pixels("means", 0), self._pixels("means", 1)
        for (rows, least), (_, most) in zip(self._blocks(fine), self._blocks(coarse), strict=True):
            share = (least[:, :3] + 256.0 * most[:, :3]) / 65535
            with np.errstate(over="ignore", invalid="ignore"):  # Gaussians with such values are removed later
                logarithms = low + (high - low) * share
                g.means[rows] = np.sign(logarithms) * np.expm1(np.abs(logarithms))

    def _higher(self, g: Gaussians, meta: Mapping[str, Any], coefficients: int) -> None:
        """Sets the higher SH coefficients. Each Gaussian stores an index into the palette, whose image has 64 entries
        per row."""
        entries, book = self._number(meta, "count"), self._codebook("shN")
        if entries > _MOST_ENTRIES:
            raise InputError(f"{self._path} has {entries} sets of SH coefficients; a SOG has at most {_MOST_ENTRIES}.")
        name = self._name("shN", 0)
        width, height = _PER_ROW * coefficients, -(-entries // _PER_ROW)
        picture = self._files.image(name, width * (height + _PER_ROW))
        wrong = f"{self._path}: {name} does not hold {entries} sets of coefficients; {_THEN}."
        if picture.shape[1] != width or len(picture) < height:
            raise InputError(wrong)
        palette = picture[..., :3].reshape(-1, coefficients, 3)
        for rows, pixels in self._blocks(self._pixels("shN", 1)):
            labels = pixels[:, 0] + 256 * pixels[:, 1].astype(np.intp)
            if labels.max(initial=0) >= entries:
                raise InputError(wrong)
            g.sh[rows, 1:] = book[palette[labels]]

    def _pixels(self, part: str, index: int = 0) -> Bytes:
        """(count, 4) uint8."""
        name = self._name(part, index)
        image = self._files.image(name, 2 * self._count + (1 << 16))
        flat = image.reshape(-1, 4)
        if len(flat) < self._count:
            raise InputError(f"{self._path}: {name} has {len(flat)} pixels for {self._count} Gaussians; {_THEN}.")
        return flat[: self._count]

    def _blocks(self, pixels: Bytes) -> Iterator[tuple[slice, Bytes]]:
        for first in range(0, self._count, ROWS):
            rows = slice(first, min(first + ROWS, self._count))
            yield rows, pixels[rows]

    def _part(self, name: str) -> Mapping[str, Any]:
        part = self._meta.get(name)
        if not isinstance(part, Mapping) or not isinstance(part.get("files"), list):
            raise InputError(f"{self._path} has a meta.json without the {name} of a SOG; {_THEN}.")
        return part

    def _name(self, part: str, index: int) -> str:
        names = self._part(part)["files"]
        if index >= len(names) or not _is_name(names[index]):
            raise InputError(f"{self._path}: meta.json names no image {index} of {part}; {_THEN}.")
        return str(names[index])

    def _number(self, meta: Mapping[str, Any], name: str) -> int:
        value = meta.get(name)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < 1 << 31:
            raise InputError(f"{self._path}: {name} is {value_text(value)} in meta.json; it must be a count; {_THEN}.")
        return value

    def _triple(self, name: str) -> NDArray[np.float64]:
        return self._numbers(self._part("means").get(name), 3, f"{name} of means", np.float64)

    def _codebook(self, part: str) -> NDArray[np.float32]:
        book = self._part(part).get("codebook")
        return self._numbers(book, _ENTRIES, f"the codebook of {part}", np.float32)

    def _numbers(self, values: object, count: int, what: str, kind: type[Float]) -> NDArray[Float]:
        if not isinstance(values, list) or len(values) != count:
            found = f"{len(values)} entries" if isinstance(values, list) else "no list"
            raise InputError(f"{self._path}: {what} has {found}, not {count}; {_THEN}.")
        good = [isinstance(v, int | float) and abs(v) < 1e30 and math.isfinite(v) for v in values]
        if not all(good):
            wrong = value_text(values[good.index(False)])
            raise InputError(f"{self._path}: {what} contains {wrong}, which is not a valid number; {_THEN}.")
        return np.array(values, kind)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value.isprintable() and len(value) <= _LONGEST_NAME


def _rotations(path: Path, pixels: Bytes) -> NDArray[np.float32]:
    """(N, 4) w x y z. A pixel stores three components times the square root of two. Its tag names the omitted, largest
    component."""
    left_out = pixels[:, 3].astype(np.int64) - _FIRST_TAG
    if (left_out < 0).any():
        raise InputError(f"{path} has rotations of an unknown kind; {_THEN}.")
    three = (pixels[:, :3] / 255 * 2 - 1) / np.sqrt(2)
    quats = np.empty((len(pixels), 4))
    rows = np.arange(len(pixels))
    for k in range(3):
        quats[rows, k + (k >= left_out)] = three[:, k]
    quats[rows, left_out] = np.sqrt(np.maximum(1 - (three**2).sum(axis=1), 0))
    return quats.astype(np.float32)


INDEX = "lod-meta.json"
_MOST_GAUSSIANS = 5_000_000  # Gaussians that are read; the finest level with at most that many is chosen
_INDEX_WHAT = "the index of a streamed SOG"
_LEVELS = tuple(map(str, range(16)))


@dataclass(frozen=True)
class StreamedLevel:
    """A level of detail.

    number  0 is the finest
    levels  number of levels of the scene
    count   Gaussians of the level
    finest  Gaussians of level 0
    files   paths of its SOGs
    """

    number: int
    levels: int
    count: int
    finest: int
    files: tuple[Path, ...]


def level_to_read(index: Path) -> StreamedLevel:
    """The finest level with at most 5 million Gaussians, or the coarsest level if each has more.

    Raises InputError if lod-meta.json cannot be read, has no level, or names a file outside its folder."""
    meta = read_json(index, _INDEX_WHAT, _THEN)
    names = meta.get("filenames") if isinstance(meta, Mapping) else None
    if not isinstance(names, list) or not names:
        raise InputError(f"{index} has no list of file names and is not {_INDEX_WHAT}; {_THEN}.")
    counts: dict[int, int] = {}
    files: dict[int, set[int]] = {}
    boxes = [meta.get("tree")]
    while boxes:
        box = boxes.pop()
        children, parts = (box.get("children", []), box.get("lods", {})) if isinstance(box, Mapping) else (None, None)
        if not isinstance(children, list) or not isinstance(parts, Mapping):
            raise InputError(f"{index} has no valid tree of boxes; {_THEN}.")
        boxes += children
        for level, part in parts.items():
            file, count = (part.get("file"), part.get("count")) if isinstance(part, Mapping) else (None, None)
            if level not in _LEVELS or not _is_below(file, len(names)) or not _is_below(count, 1 << 31):
                raise InputError(f"{index} has {value_text(part)} as level {value_text(level)} of a box; {_THEN}.")
            counts[int(level)] = counts.get(int(level), 0) + count
            files.setdefault(int(level), set()).add(file)
    if not counts:
        raise InputError(f"{index} has no level of detail; {_THEN}.")
    number = min((n for n, count in counts.items() if count <= _MOST_GAUSSIANS), default=max(counts))
    paths = tuple(_path(index, names[i]) for i in sorted(files[number]))
    return StreamedLevel(number, len(counts), counts[number], counts[min(counts)], paths)


def _is_below(value: object, limit: int) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < limit


def _path(index: Path, name: object) -> Path:
    path = PurePosixPath(name if isinstance(name, str) else "")
    if (
        path.is_absolute()
        or ".." in path.parts
        or "\\" in path.name
        or not (path.name == META or path.suffix == ".sog")
    ):
        raise InputError(f"{index} names {value_text(name)}, which is not a SOG in its folder; {_THEN}.")
    return index.parent / path
