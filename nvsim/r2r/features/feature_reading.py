"""Reads features from the files that agents use, written by `nvsim export features` or by other programs."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened, read_json
from nvsim.geometry.view_sweep import VIEWS
from nvsim.r2r.features import hdf5_file
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.feature_files import about_of
from nvsim.r2r.features.hdf5_file import THEN, WHAT, WIDEST
from nvsim.r2r.features.layouts import LAYOUTS

Key = tuple[str, str]
"""Scan id and viewpoint id."""


def features_of(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    """Yields (36, width) float32 for each viewpoint in `wanted`, in any order.

    If the file has the name of a layout, only the numbers that the layout's agents read are returned; else all numbers.

    Raises InputError if the file is unreadable, lacks a viewpoint, or does not have 36 finite rows for one.
    """
    width = next((layout.width for layout in LAYOUTS.values() if layout.file == path.name), WIDEST)
    read = _of_tsv if path.suffix == ".tsv" else _of_hdf5
    left = set(wanted)
    with reading(path, WHAT, THEN):
        for key, row in read(path, wanted):
            left.discard(key)
            if not np.isfinite(row).all():
                raise InputError(f"{path}: the features of {key[0]}_{key[1]} are not all finite; {THEN}.")
            yield key, np.ascontiguousarray(row[:, :width], np.float32)
    if left:
        scan, viewpoint = min(left)
        raise InputError(
            f"{path} has no features of {len(left)} viewpoints, the first {scan}_{viewpoint}; write the features of "
            "all scans with `nvsim export features`."
        )


def made_by(path: Path) -> str:
    """Returns the name of the backbone that made a file, or "" if unknown. Raises InputError if it is unreadable."""
    if path.suffix == ".tsv":
        beside = about_of(path)
        about = read_json(beside, "a record of features", THEN) if beside.is_file() else {}
        return str(about.get("backbone", "")) if isinstance(about, dict) else ""
    return hdf5_file.made_by(path)


def _of_hdf5(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    keys = {f"{scan}_{viewpoint}": (scan, viewpoint) for scan, viewpoint in wanted}
    for name, row in hdf5_file.rows_of(path, list(keys)):
        yield keys[name], row


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
                raise InputError(f"{path}: {scan}_{viewpoint} has {len(numbers)} numbers, not {VIEWS} rows; {THEN}.")
            yield (scan, viewpoint), numbers.reshape(VIEWS, -1)
