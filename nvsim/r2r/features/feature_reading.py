"""Reads features from the files that agents use, written by `nvsim export features` or by other programs.

A separate process reads HDF5 files, because the HDF5 library may crash on a damaged file, or never return from it.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import opened, read_json
from nvsim.files.reading import reading
from nvsim.geometry.directions import VIEWS
from nvsim.processes.child import Child, Limits
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.feature_files import about_of
from nvsim.r2r.features.layouts import LAYOUTS

WHAT = "a features file"
THEN = "write it again with `nvsim export features`"
WIDEST = 1 << 16
"""Largest number of numbers for each view."""
_LIMITS = Limits(seconds=20, memory=512 << 20, computing=1.0)
"""Limits for each answer, which normally takes milliseconds and a few MB."""
_AT_ONCE = 16
"""Viewpoints in each answer."""
Key = tuple[str, str]
"""Scan id and viewpoint id."""


@dataclass(frozen=True)
class Open:
    """Request: open a file and close the previous one. The answer is the name of the backbone, "" if unknown."""

    path: Path


@dataclass(frozen=True)
class Read:
    """Request: read datasets by name. The answer is a list of (36, width) float32, with None for missing names."""

    names: Sequence[str]


class Hdf5Server:
    """Runs in the child process and answers Open and Read."""

    def __init__(self) -> None:
        import h5py

        self._library = h5py
        self._open = ExitStack()
        self._path = Path()
        self._file: Any = None

    def __call__(self, request: Open | Read) -> str | list[NDArray[np.float32] | None]:
        if isinstance(request, Read):
            with reading(self._path, WHAT, THEN):
                return [self._row(name) for name in request.names]
        self._open.close()
        self._path = request.path
        with reading(self._path, WHAT, THEN):
            file = self._open.enter_context(opened(self._path))
            self._file = self._open.enter_context(self._library.File(file, "r"))
            return str(self._file.attrs.get("backbone", ""))

    def _row(self, name: str) -> NDArray[np.float32] | None:
        h5py, stored = self._library, self._file
        assert stored is not None
        # Links and virtual datasets refer to other files, so they are ignored.
        if not isinstance(stored.get(name, getlink=True), h5py.HardLink):
            return None
        data: Any = stored[name]
        if not isinstance(data, h5py.Dataset) or data.external is not None or data.is_virtual:
            return None
        if data.dtype.kind != "f" or data.ndim != 2 or data.shape[0] != VIEWS or not 1 <= data.shape[1] <= WIDEST:
            raise InputError(
                f"{self._path}: {name} is {data.dtype} of shape {data.shape}, not {VIEWS} rows of numbers; {THEN}."
            )
        return np.ascontiguousarray(data[()], np.float32)


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
    with Child(Hdf5Server, str(path), THEN) as child:
        return str(child.ask(Open(path), _LIMITS))


def _of_hdf5(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    with Child(Hdf5Server, str(path), THEN) as child:
        child.ask(Open(path), _LIMITS)
        for at in range(0, len(wanted), _AT_ONCE):
            keys = wanted[at : at + _AT_ONCE]
            rows: Any = child.ask(Read([f"{scan}_{viewpoint}" for scan, viewpoint in keys]), _LIMITS)
            yield from ((key, row) for key, row in zip(keys, rows, strict=True) if row is not None)


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
