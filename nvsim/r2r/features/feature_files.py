"""Reads and writes features in the HDF5, TSV, and LMDB files that agents use.

HDF5: a dataset "<scan>_<viewpoint>" of (36, width) float32, gzip, with scanId, viewpointId, image_w, image_h, vfov.
TSV: no header, scanId, viewpointId, image_w, image_h, vfov, base64 of (36, width) float32. Views are in the order of
viewIndex. The record of how the features were made is in the attributes of the HDF5 file, or in a JSON file beside
the other files.
LMDB: the value of a key SCAN_VIEWPOINT is a msgpack of an array: the bytes `data`, the NumPy `type`, and the `shape`
(candidates, tokens, width). Source: NavGPT-2, map_nav_src/utils/data.py.

A separate process reads HDF5 files, because the HDF5 library may crash on a damaged file, or never return from it.
"""

from __future__ import annotations

import base64
import io
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error, make_own_folder, move_into_place, private_folder
from nvsim.files.opening import opened, read_json
from nvsim.files.reading import reading
from nvsim.geometry.directions import VIEWS
from nvsim.processes.child import Child, Limits
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.kept_rows import KeptRows
from nvsim.r2r.features.layouts import LAYOUTS

_LONGEST_KEY = 480  # bytes; LMDB allows 511


class QuietFile(io.RawIOBase):
    """A file for h5py, which reads and writes a descriptor. Failed writes are reported by `check` only.

    If a write fails, the HDF5 library prints a traceback for each object that it closes, and may end the process with a
    segmentation fault. This file reports success to the library, and the caller discards the file.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._at = descriptor, 0
        self._error: OSError | None = None

    def check(self) -> None:
        """Raises OSError if a write has failed."""
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: os.fstat(self._descriptor).st_size}[whence]
        self._at = start + offset
        return self._at

    def readinto(self, buffer: Any) -> int:
        count = os.preadv(self._descriptor, [buffer], self._at)
        self._at += count
        return count

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            written = 0
            while self._error is None and written < len(view):
                written += os.pwrite(self._descriptor, view[written:], self._at + written)
        except OSError as error:
            self._error = error
        self._at += len(view)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        size = self._at if size is None else size
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as error:
            self._error = self._error or error
        return size


@contextmanager
def quietly_written(path: Path) -> Iterator[QuietFile]:
    """Yields a new file at `path`. Raises OSError if opening fails, or after the block if a write failed."""
    with open(path, "wb+") as file:
        quiet = QuietFile(file.fileno())
        yield quiet
        quiet.check()


@dataclass(frozen=True)
class RowSource:
    """The source of a row: scan, viewpoint, and width and height of its views in pixels."""

    scan: str
    viewpoint: str
    size: tuple[int, int]


Rows = Iterable[tuple[RowSource, Float32]]
About = dict[str, str | int]


def write_hdf5(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    import h5py

    with atomic.replacement_file(path) as temporary, quietly_written(temporary) as quiet, h5py.File(quiet, "w") as file:
        file.attrs.update(about)
        for place, row in rows:
            data = file.create_dataset(f"{place.scan}_{place.viewpoint}", data=row, compression="gzip")
            data.attrs["scanId"], data.attrs["viewpointId"] = place.scan, place.viewpoint
            data.attrs["image_w"], data.attrs["image_h"] = place.size
            data.attrs["vfov"] = vfov
            quiet.check()


def write_tsv(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    with atomic.replacement_file(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        for place, row in rows:
            values = base64.b64encode(row.tobytes()).decode("ascii")
            file.write("\t".join([place.scan, place.viewpoint, *map(str, place.size), str(vfov), values]) + "\n")
    atomic.write_text(description_path(path), json.dumps(about, indent=1) + "\n")


def description_path(file: Path) -> Path:
    """Returns the path of the JSON file beside a TSV or an LMDB."""
    return file.with_suffix(".json")


def lmdb_key(key: str) -> bytes:
    """Returns the key of an array in an LMDB. Raises InputError if it is not short ASCII."""
    name = key.encode("utf-8", "surrogateescape")
    if not name.isascii() or len(name) > _LONGEST_KEY:
        raise InputError(f"An LMDB cannot store the key {key[:60]!r}; use short ASCII ids for scans and viewpoints.")
    return name


def packed_array(array: NDArray[np.float32]) -> bytes:
    """Returns the value of an array of any shape in an LMDB."""
    import msgpack

    packed: bytes = msgpack.packb({b"data": array.tobytes(), b"type": array.dtype.str, b"shape": array.shape})
    return packed


def write_lmdb(target: Path, rows: KeptRows, keys: Mapping[str, bytes], room: int) -> None:
    """Writes an LMDB to the folder `target` from kept rows of packed arrays.

    keys  key of each kept row -> its key in the LMDB
    room  bytes of all arrays together

    An LMDB does not survive a power loss unless it waits for the disk after every array, and a damaged file crashes it,
    so it is written when all rows are complete. Meanwhile, the disk holds the arrays twice. Raises InputError if
    reading or writing fails.
    """
    import lmdb

    # Some pages are free or half empty. The file only grows as large as its content.
    largest = round(1.3 * room) + len(keys) * (1 << 15) + (1 << 26)
    with private_folder(target) as folder:
        data = folder / "data.mdb"
        try:
            # Syncs the whole file once at the end, not after every transaction.
            with lmdb.open(str(folder), map_size=largest, max_dbs=0, sync=False) as environment:
                for key, name in sorted(keys.items(), key=lambda item: item[1]):
                    with environment.begin(write=True) as transaction:
                        transaction.put(name, rows.get(key), append=True)
            move_into_place(data, make_own_folder(target) / data.name)
        except lmdb.Error as error:
            raise InputError(f"Cannot write {target}: {error}; free some space and start again.") from error
        except OSError as error:
            raise as_input_error(target, error) from error


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
class OpenRequest:
    """Request: open a file and close the previous one. The answer is the name of the backbone, "" if unknown."""

    path: Path


@dataclass(frozen=True)
class ReadRequest:
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

    def __call__(self, request: OpenRequest | ReadRequest) -> str | list[NDArray[np.float32] | None]:
        if isinstance(request, ReadRequest):
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


def backbone_of_file(path: Path) -> str:
    """Returns the name of the backbone that made a file, or "" if unknown. Raises InputError if it is unreadable."""
    if path.suffix == ".tsv":
        beside = description_path(path)
        about = read_json(beside, "a record of features", THEN) if beside.is_file() else {}
        return str(about.get("backbone", "")) if isinstance(about, dict) else ""
    with Child(Hdf5Server, str(path), THEN) as child:
        return str(child.ask(OpenRequest(path), _LIMITS))


def _of_hdf5(path: Path, wanted: Sequence[Key]) -> Iterator[tuple[Key, Float32]]:
    with Child(Hdf5Server, str(path), THEN) as child:
        child.ask(OpenRequest(path), _LIMITS)
        for at in range(0, len(wanted), _AT_ONCE):
            keys = wanted[at : at + _AT_ONCE]
            rows: Any = child.ask(ReadRequest([f"{scan}_{viewpoint}" for scan, viewpoint in keys]), _LIMITS)
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
