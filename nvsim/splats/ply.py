"""Read and write Gaussians as PLY in the layout of the INRIA reference program, in binary and in text format.

The reader of text reads a few lines at a time and needs a few extra megabytes.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from io import FileIO
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.ply import BinaryRows, binary_rows, text_rows
from nvsim.capture.point_table import parse_numbers
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import opened, size_of
from nvsim.files.reading import reading
from nvsim.splats.types import Gaussians

_VALUES = 1 << 16
_LONGEST_VALUE = 64
"""Largest number of characters of a number, including the space after it."""
_SHORTEST_VALUE = 2


def read_ascii(path: Path, file: FileIO, begin: bytes) -> Gaussians:
    """Reads Gaussians from a file. `begin` contains its complete and valid header. Raises InputError naming the invalid
    line, or if the file ends early."""
    end, header, skipped, count, names = text_rows(path, begin)
    file.seek(0, io.SEEK_END)
    if (skipped + count * len(names)) * _SHORTEST_VALUE > file.tell() - end + _SHORTEST_VALUE:
        raise InputError(f"{path} is truncated: {count} Gaussians announced, but the file ends early; copy it again.")
    gaussians, targets = _prepare_arrays(path, count, names)
    file.seek(end)
    lines = _lines(path, io.BufferedReader(file), header + 1, len(names) * _LONGEST_VALUE)
    for _ in range(skipped):
        next(lines, None)
    at, columns = 0, [(names.index(name), target) for name, target in targets.items()]
    step = max(1, _VALUES // len(names))
    while at < count:
        block = list(islice(lines, min(step, count - at)))
        if len(block) < min(step, count - at):
            raise InputError(
                f"{path} is truncated: {count} Gaussians announced, {at + len(block)} present; copy it again."
            )
        values = parse_numbers(path, block, len(names), "export it again")
        with np.errstate(over="ignore"):  # Gaussians with infinite values are removed later
            for column, target in columns:
                target[at : at + len(block)] = values[:, column]
        at += len(block)
    _apply_filter(gaussians, targets)
    return gaussians


def _lines(path: Path, file: io.BufferedReader, number: int, longest: int) -> Iterator[tuple[int, bytes]]:
    """Lines that are not empty, each with its number. Raises InputError if a line is too long."""
    while line := file.readline(longest + 1):
        if len(line) > longest:
            raise InputError(f"{path}, line {number}: it has more than {longest} characters; export it again.")
        if line.strip():
            yield number, line
        number += 1


_REST_OF_DEGREE = {0: 0, 1: 9, 2: 24, 3: 45}
_MEAN, _DC = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE, _ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
_THICKNESS, _FILTER = _SCALE[2], "filter_3D"
_FLAT = 6.0  # logarithm of the smaller width of a disk over its thickness
_NORMAL = ("nx", "ny", "nz")  # always zero, but some readers require them
_ROWS = 4096  # 1 MB at degree 3: a block stays in the second-level cache while it is split into columns
_BLOCK = 1 << 21
_LONGEST_HEADER = 1 << 16
_ANTIALIASED = {"antialiased 1": True, "antialiased 0": False}
_BRUSH_MODES = {"SplatRenderMode: mip": True, "SplatRenderMode: default": False}


def write_ply(path: Path, gaussians: Gaussians, antialiased: bool) -> None:
    """Writes the file atomically. The comments "antialiased 0|1" (Postshot) and "SplatRenderMode: mip|default" (Brush)
    tell how to render the Gaussians. Needs one megabyte in addition to the Gaussians.

    Raises InputError if the disk refuses.
    """
    g = gaussians
    n, coefficients = len(g), g.sh.shape[1]
    rest = 3 * (coefficients - 1)
    names = [*_MEAN, *_NORMAL, *_DC, *(f"f_rest_{i}" for i in range(rest)), "opacity", *_SCALE, *_ROTATION]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment antialiased {int(antialiased)}",
        f"comment SplatRenderMode: {'mip' if antialiased else 'default'}",
        "comment Vertical Axis: z",
        f"element vertex {n}",
        *(f"property float {name}" for name in names),
        "end_header",
    ]
    block = np.zeros((_ROWS, len(names)), "<f4")
    with atomic.replacement_file(path) as temporary, open(temporary, "wb", buffering=0) as file:
        _write(file, ("\n".join(header) + "\n").encode("ascii"))
        for first in range(0, n, _ROWS):
            rows, part = block[: min(_ROWS, n - first)], slice(first, first + _ROWS)
            rows[:, 0:3] = g.means[part]
            rows[:, 6:9] = g.sh[part, 0]
            for color in range(3):
                at = 9 + color * (coefficients - 1)
                rows[:, at : at + coefficients - 1] = g.sh[part, 1:, color]
            rows[:, 9 + rest] = g.opacity_logits[part]
            rows[:, 10 + rest : 13 + rest] = g.log_scales[part]
            rows[:, 13 + rest :] = g.quats[part]
            _write(file, rows.tobytes())


def _write(file: FileIO, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


def read_ply(path: Path) -> tuple[Gaussians, bool | None]:
    """The Gaussians, and whether the file says to render them with antialiasing (None if it does not say).

    Properties may be in any order with others between them, and normals may be missing. The disks of 2DGS have no third
    scale and become flat Gaussians. The 3D filter of Mip-Splatting, GOF, and RaDe-GS is applied, and antialiasing is
    assumed then. Values that are not finite are kept. A binary file is read block by block and needs one megabyte in
    addition to the result (with a filter, also 4 bytes for each Gaussian). Raises InputError
    naming the file and the defect.
    """
    with opened(path) as file, reading(path, "a PLY file of Gaussians"):
        begin = file.read(_LONGEST_HEADER)
        if not begin.startswith(b"ply"):
            raise InputError(f"{path} does not begin like a PLY file; choose a PLY file of Gaussians.")
        rows = binary_rows(path, begin, size_of(file))
        if rows is None:
            gaussians = read_ascii(path, file, begin)
        else:
            gaussians, targets = _prepare_arrays(path, rows.count, rows.layout.names or ())
            for _ in _blocks(path, file, rows, targets):
                pass
            _apply_filter(gaussians, targets)
    return gaussians, _render_mode(begin)


def read_gaussians(path: Path, hashed: bool) -> tuple[Gaussians, str | None]:
    """The Gaussians of a file written by `write_ply`, and the SHA-256 of the file if `hashed`.

    Raises InputError if the file has another layout, is truncated, or has values that are not finite. Raises OSError if
    it cannot be read.
    """
    digest = hashlib.sha256()
    with opened(path) as file:
        begin = file.read(_LONGEST_HEADER)
        try:
            rows = binary_rows(path, begin, size_of(file))
            columns = () if rows is None else rows.layout.names or ()
            if not begin.startswith(b"ply") or rows is None or any(rows.layout[c] != np.dtype("<f4") for c in columns):
                raise InputError("It is not a PLY file of float32 in little-endian order.")
            gaussians, targets = _prepare_arrays(path, rows.count, columns)
            if _THICKNESS not in targets or _FILTER in targets:
                raise InputError("It is the file of another program.")
        except InputError as error:
            raise InputError(
                f"{path} is truncated or does not have the layout that NVSim writes; train this submap again."
            ) from error
        digest.update(begin[: rows.start])
        for block in _blocks(path, file, rows, targets):
            if hashed:
                digest.update(block.view(np.uint8))  # type: ignore[arg-type]
            if not np.isfinite(block.view("<f4")).all():
                raise InputError(f"{path} contains values that are not finite; train this submap again.")
        while hashed and (more := file.read(1 << 20)):
            digest.update(more)
    return gaussians, digest.hexdigest() if hashed else None


def _blocks(
    path: Path, file: FileIO, rows: BinaryRows, targets: dict[str, NDArray[np.float32]]
) -> Iterator[NDArray[np.void]]:
    """Reads the rows block by block into `targets`, and yields each block before it is overwritten."""
    file.seek(rows.start)
    block = np.empty(max(1, min(_ROWS, _BLOCK // rows.layout.itemsize)), rows.layout)
    for first in range(0, rows.count, len(block)):
        part = block[: min(len(block), rows.count - first)]
        _fill(path, file, part)
        with np.errstate(over="ignore"):  # doubles beyond the range of float32 become infinite
            for name, target in targets.items():
                target[first : first + len(part)] = part[name]
        yield part


def _prepare_arrays(
    path: Path, n: int, properties: tuple[str, ...]
) -> tuple[Gaussians, dict[str, NDArray[np.float32]]]:
    """Arrays for `n` Gaussians, and for each property the view (n,) of them that stores it; the 3D filter has an array
    of its own. Raises InputError if properties are missing. The third scale may be missing if both others are there."""
    missing = [name for name in (*_MEAN, *_DC, "opacity", *_SCALE, *_ROTATION) if name not in properties]
    if missing == [_THICKNESS]:
        missing = []
    if missing:
        raise InputError(
            f"{path} has no property {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}, so it does not"
            " contain Gaussians; export it in the layout of the INRIA program."
        )
    rest = sum(name.startswith("f_rest_") for name in properties)
    if rest not in _REST_OF_DEGREE.values() or any(f"f_rest_{i}" not in properties for i in range(rest)):
        raise InputError(
            f"{path} has {rest} properties f_rest_*, but spherical harmonics of degree 0 to 3 have"
            " 0, 9, 24 or 45 of them (from f_rest_0); export it with degree 3 or less."
        )
    k = 1 + rest // 3
    shapes = (n, 3), (n, 3), (n, 4), (n,), (n, k, 3)
    g = Gaussians(*(np.empty(shape, np.float32) for shape in shapes))
    targets = {"opacity": g.opacity_logits}
    for names, array in ((_MEAN, g.means), (_SCALE, g.log_scales), (_ROTATION, g.quats), (_DC, g.sh[:, 0])):
        targets |= {name: array[:, i] for i, name in enumerate(names) if name in properties}
    targets |= {f"f_rest_{i}": g.sh[:, 1 + i % (k - 1), i // (k - 1)] for i in range(rest)}
    if _FILTER in properties:
        targets[_FILTER] = np.empty(n, np.float32)
    return g, targets


def _apply_filter(g: Gaussians, targets: dict[str, NDArray[np.float32]]) -> None:
    """Computes a missing third scale, and applies the 3D filter: each Gaussian is convolved with a round one of that
    width, and becomes less opaque as it grows (Yu et al. 2024, Mip-Splatting)."""
    if _THICKNESS not in targets:
        g.log_scales[:, 2] = g.log_scales[:, :2].min(axis=1) - _FLAT
    if _FILTER not in targets:
        return
    for first in range(0, len(g), _ROWS):
        rows = slice(first, first + _ROWS)
        before = g.log_scales[rows].astype(np.float64)
        with np.errstate(all="ignore"):  # values that are not finite are removed later
            after = 0.5 * np.logaddexp(2 * before, 2 * np.log(np.abs(targets[_FILTER][rows, None], dtype=np.float64)))
            share, logits = (before - after).sum(axis=1), g.opacity_logits[rows].astype(np.float64)
            g.opacity_logits[rows] = logits + share - np.logaddexp(0, logits + np.log(-np.expm1(share)))
        g.log_scales[rows] = after


def _fill(path: Path, file: FileIO, rows: NDArray[np.void]) -> None:
    left = memoryview(rows.view(np.uint8))  # type: ignore[arg-type]
    while left:
        got = file.readinto(left)
        if not got:
            raise InputError(f"{path} became shorter while it was read; try again when it is completely written.")
        left = left[got:]


def _render_mode(data: bytes) -> bool | None:
    header = data[: data.find(b"end_header")].decode("ascii", "replace")
    for line in header.splitlines():
        text = line.removeprefix("comment ").strip()
        for known in (_ANTIALIASED, _BRUSH_MODES):
            if text in known:
                return known[text]
    return True if f" {_FILTER}\n" in header.replace("\r", "") else None
