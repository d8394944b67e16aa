"""Arrays out of .npz and .npy files: their types and shapes are read and judged before their data is.

An .npz is a zip archive (numpy.lib.format). A damaged or foreign one may announce any shape, hold objects, or unpack a
few kilobytes to gigabytes.
"""

from __future__ import annotations

import io
import math
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened

_HEADER = 10_000  # characters; ours have about 80
_ANYWAY = 64_000_000  # bytes that any file may unpack to
_EXPANSION = 10  # times its own bytes that a larger one may
Wanted = Mapping[str, tuple[str, int]]


def read_arrays(
    path: Path, what: str, wanted: Wanted, then: str, optional: frozenset[str] = frozenset()
) -> dict[str, NDArray[Any]]:
    """The arrays of `path` by name.

    wanted    name -> (kinds of numbers it may hold as numpy's letters "bfiu", its number of dimensions)
    then      what the user can do about a broken file
    optional  those of `wanted` that may be absent

    Raises InputError when the file is missing, damaged, lacks an array, or holds one of another type or size.
    """
    with reading(path, what, then), opened(path) as file:
        length = os.fstat(file.fileno()).st_size
        with zipfile.ZipFile(file) as archive:
            entries = {entry.filename: entry for entry in archive.infolist()}
            names = [n for n in wanted if n not in optional or f"{n}.npy" in entries]
            missing = [n for n in names if f"{n}.npy" not in entries]
            if missing:
                raise InputError(f"{path} is not {what}: it has no array {missing[0]!r}; {then}.")
            left = max(_ANYWAY, _EXPANSION * length)
            result = {}
            for name in names:
                entry = entries[f"{name}.npy"]
                left -= entry.file_size
                if left < 0 or entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise InputError(f"{path} unpacks to far more than its {length} bytes; {then}.")
                result[name] = _array(archive, entry, *wanted[name])
    return result


def array_of(data: bytes, path: Path, what: str, then: str) -> NDArray[Any]:
    """The array in `data`, the content of the .npy file `path`. Raises InputError when it is damaged, or is no array of
    numbers as long as its header says."""
    with reading(path, what, then):
        file = io.BytesIO(data)
        shape, dtype = _header(file, path.name)
        if dtype.kind not in "bfiu" or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
            raise ValueError(f"it is {dtype} of shape {shape}, which is not what it holds")
        file.seek(0)
        return np.lib.format.read_array(file, allow_pickle=False, max_header_size=_HEADER)


def _header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """The shape and the type of an array in the .npy format. Raises ValueError."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if read is None:
        raise ValueError(f"array {name!r} has version {version}")
    try:
        shape, _, dtype = read(file, max_header_size=_HEADER)
    except Exception as error:  # numpy evaluates the header as a Python literal
        raise ValueError(f"array {name!r} has a header that makes no sense") from error
    if min(shape, default=1) < 0:
        raise ValueError(f"array {name!r} has the shape {shape}")
    return shape, dtype


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, kinds: str, dimensions: int) -> NDArray[Any]:
    with archive.open(entry) as file:
        shape, dtype = _header(file, entry.filename)
        if dtype.kind not in kinds or len(shape) != dimensions:
            raise ValueError(f"array {entry.filename!r} is {dtype} of shape {shape}")
        if math.prod(shape) * dtype.itemsize != entry.file_size - file.tell():
            raise ValueError(f"array {entry.filename!r} does not have the size that its shape {shape} needs")
    with archive.open(entry) as file:
        return np.lib.format.read_array(file, allow_pickle=False, max_header_size=_HEADER)
