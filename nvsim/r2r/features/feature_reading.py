"""Features read back from the files that agents open, `nvsim export features` or others have written them."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened, read_json
from nvsim.geometry.view_sweep import VIEWS
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.feature_files import about_of
from nvsim.r2r.features.layouts import LAYOUTS

_WHAT = "a file of features"
_THEN = "write it again with `nvsim export features`"
WIDEST = 1 << 16
"""Numbers of a view."""
Key = tuple[str, str]
"""Scan id and viewpoint id."""


def features_of(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    """(36, width) float32 of each viewpoint of `wanted`, in any order: of a file named as one of the layouts the
    numbers that its agents read, of others all.

    Raises InputError where the file cannot be read, lacks one of them, or holds anything else than 36 finite rows.
    """
    width = next((layout.width for layout in LAYOUTS.values() if layout.file == path.name), WIDEST)
    read = _of_tsv if path.suffix == ".tsv" else _of_hdf5
    left = set(wanted)
    with reading(path, _WHAT, _THEN):
        for key, row in read(path, wanted):
            left.discard(key)
            if not np.isfinite(row).all():
                raise InputError(f"{path}: the features of {key[0]}_{key[1]} are not all finite; {_THEN}.")
            yield key, np.ascontiguousarray(row[:, :width], np.float32)
    if left:
        scan, viewpoint = min(left)
        raise InputError(
            f"{path} has no features of {len(left)} viewpoints, the first {scan}_{viewpoint}; write those of all scans "
            "with `nvsim export features`."
        )


def made_by(path: Path) -> str:
    """What made the numbers of a file, "" where it does not say. Raises InputError where it cannot be read."""
    if path.suffix == ".tsv":
        beside = about_of(path)
        about = read_json(beside, "what is said of features", _THEN) if beside.is_file() else {}
        return str(about.get("backbone", "")) if isinstance(about, dict) else ""
    import h5py

    with reading(path, _WHAT, _THEN), opened(path) as file, h5py.File(file, "r") as stored:
        return str(stored.attrs.get("backbone", ""))


def _of_hdf5(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    import h5py

    with opened(path) as file, h5py.File(file, "r") as stored:
        for scan, viewpoint in wanted:
            name = f"{scan}_{viewpoint}"
            # What a link or a virtual dataset names lies in another file.
            if not isinstance(stored.get(name, getlink=True), h5py.HardLink):
                continue
            data: Any = stored[name]
            if not isinstance(data, h5py.Dataset) or data.external is not None or data.is_virtual:
                continue
            if data.dtype.kind != "f" or data.ndim != 2 or data.shape[0] != VIEWS or not 1 <= data.shape[1] <= WIDEST:
                raise InputError(
                    f"{path}: {name} is {data.dtype} of shape {data.shape}, not {VIEWS} rows of numbers; {_THEN}."
                )
            yield (scan, viewpoint), np.asarray(data[()], np.float32)


def _of_tsv(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    looked_for = set(wanted)
    longest = 2000 + math.ceil(4 / 3 * 4 * VIEWS * WIDEST)
    with opened(path) as raw:
        file = io.BufferedReader(raw)
        while line := file.readline(longest):
            scan, viewpoint, *_, values = line.decode("utf-8").rstrip("\n").split("\t")
            if (scan, viewpoint) not in looked_for:
                continue
            looked_for.discard((scan, viewpoint))
            numbers = np.frombuffer(base64.b64decode(values, validate=True), "<f4")
            if not len(numbers) or len(numbers) % VIEWS:
                raise InputError(f"{path}: {scan}_{viewpoint} has {len(numbers)} numbers, not {VIEWS} rows; {_THEN}.")
            yield (scan, viewpoint), numbers.reshape(VIEWS, -1)
