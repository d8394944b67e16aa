"""Reads features from an HDF5 file in a separate process.

The HDF5 library may crash on a damaged file, or never return from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened
from nvsim.geometry.view_sweep import VIEWS
from nvsim.processes.child import Child, Limits

WHAT = "a features file"
THEN = "write it again with `nvsim export features`"
WIDEST = 1 << 16
"""Largest number of numbers for each view."""
_LIMITS = Limits(seconds=20, memory=512 << 20, computing=1.0)
"""Limits for each answer, which normally takes milliseconds and a few MB."""
_AT_ONCE = 16
"""Viewpoints in each answer."""


@dataclass(frozen=True)
class Open:
    """Request: open a file and close the previous one. The answer is the name of the backbone, "" if unknown."""

    path: Path


@dataclass(frozen=True)
class Read:
    """Request: read datasets by name. The answer is a list of (36, width) float32, with None for missing names."""

    names: Sequence[str]


def made_by(path: Path) -> str:
    """Returns the name of the backbone that made the file, or "" if unknown. Raises InputError if it is unreadable."""
    with Child(Hdf5Server, str(path), THEN) as child:
        return str(child.ask(Open(path), _LIMITS))


def rows_of(path: Path, names: Sequence[str]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yields the name and features (36, width) float32 for each of the `names` that the file contains.

    Raises InputError if the file is unreadable or a dataset has another shape.
    """
    with Child(Hdf5Server, str(path), THEN) as child:
        child.ask(Open(path), _LIMITS)
        for at in range(0, len(names), _AT_ONCE):
            some = names[at : at + _AT_ONCE]
            rows: Any = child.ask(Read(some), _LIMITS)
            for name, row in zip(some, rows, strict=True):
                if row is not None:
                    yield name, row


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
