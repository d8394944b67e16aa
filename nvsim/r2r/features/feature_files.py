"""Writes features to the HDF5 and TSV files that agents read.

HDF5: a dataset "<scan>_<viewpoint>" of (36, width) float32, gzip, with scanId, viewpointId, image_w, image_h, vfov.
TSV: no header, scanId, viewpointId, image_w, image_h, vfov, base64 of (36, width) float32. Views are in the order of
viewIndex. The record of how the features were made is in the attributes of the HDF5 file, or in a JSON file beside the
TSV.
"""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.files import atomic
from nvsim.r2r.features.backbone import Float32


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
class Place:
    """The source of a row: scan, viewpoint, and width and height of its views in pixels."""

    scan: str
    viewpoint: str
    size: tuple[int, int]


Rows = Iterable[tuple[Place, Float32]]
About = dict[str, str | int]


def write_hdf5(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    import h5py

    with atomic.replacing(path) as temporary, quietly_written(temporary) as quiet, h5py.File(quiet, "w") as file:
        file.attrs.update(about)
        for place, row in rows:
            data = file.create_dataset(f"{place.scan}_{place.viewpoint}", data=row, compression="gzip")
            data.attrs["scanId"], data.attrs["viewpointId"] = place.scan, place.viewpoint
            data.attrs["image_w"], data.attrs["image_h"] = place.size
            data.attrs["vfov"] = vfov
            quiet.check()


def write_tsv(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    with atomic.replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        for place, row in rows:
            values = base64.b64encode(row.tobytes()).decode("ascii")
            file.write("\t".join([place.scan, place.viewpoint, *map(str, place.size), str(vfov), values]) + "\n")
    atomic.write_text(about_of(path), json.dumps(about, indent=1) + "\n")


def about_of(tsv: Path) -> Path:
    """Returns the path of the JSON file beside a TSV."""
    return tsv.with_suffix(".json")
