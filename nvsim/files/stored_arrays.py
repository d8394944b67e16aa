"""Writes .npz files, and reads arrays from .npz and .npy files. Types and shapes are checked before the data is loaded.

An .npz is a zip archive (numpy.lib.format). A damaged or foreign archive may claim any shape, contain Python objects,
or unpack a few kilobytes to gigabytes.
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
from nvsim.files.atomic import replacement_file
from nvsim.files.opening import opened
from nvsim.files.reading import reading

_HEADER = 10_000  # characters; NVSim's headers have about 80
_ANYWAY = 64_000_000  # bytes to which any file may unpack
_EXPANSION = 10  # larger files may unpack to this multiple of their length
Wanted = Mapping[str, tuple[str, int]]


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool = True) -> None:
    """Replaces the .npz file at `path` with `arrays`: name -> array (...) of any shape. Raises InputError if it cannot
    be written."""
    with replacement_file(path) as temporary, open(temporary, "wb") as file:
        (np.savez_compressed if compressed else np.savez)(file, **arrays)  # type: ignore[arg-type]


def read_arrays(
    path: Path, what: str, wanted: Wanted, then: str, optional: frozenset[str] = frozenset()
) -> dict[str, NDArray[Any]]:
    """The arrays of `path` by name.

    wanted    name -> (allowed dtype kinds as numpy's letters "bfiu", number of dimensions); any shape is accepted
    then      the advice to the user if the file is broken
    optional  names in `wanted` that may be absent

    Raises InputError if the file is missing or damaged, lacks an array, or has an array of another type or number of
    dimensions.
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
                result[name] = array_in(archive, entry.filename, *wanted[name])
    return result


def array_of(data: bytes, path: Path, what: str, then: str) -> NDArray[Any]:
    """The array, of any shape, in `data`, which is the content of the .npy file `path`. Raises InputError if it is
    damaged, is not numeric, or does not have the size that its header claims."""
    with reading(path, what, then):
        file = io.BytesIO(data)
        shape, dtype = _header(file, path.name)
        if dtype.kind not in "bfiu" or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
            raise ValueError(f"its header claims {dtype} of shape {shape}, which does not fit its data")
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
        raise ValueError(f"array {name!r} has an invalid header ({type(error).__name__}: {error})") from error
    if min(shape, default=1) < 0:
        raise ValueError(f"array {name!r} has the shape {shape}")
    return shape, dtype


def array_in(archive: zipfile.ZipFile, entry: str, kinds: str = "bfiu", dimensions: int | None = None) -> NDArray[Any]:
    """The array (...,) of a .npz file in the entry NAME.npy. Raises ValueError if it has none of the `kinds` of types,
    another number of dimensions, or another size than its header claims."""
    with archive.open(entry) as file:
        shape, dtype = _header(file, entry)
        if dtype.kind not in kinds or dimensions not in (None, len(shape)):
            raise ValueError(f"array {entry!r} is {dtype} of shape {shape}")
        if math.prod(shape) * dtype.itemsize != archive.getinfo(entry).file_size - file.tell():
            raise ValueError(f"array {entry!r} does not have the size that its shape {shape} needs")
    with archive.open(entry) as file:
        return np.lib.format.read_array(file, allow_pickle=False, max_header_size=_HEADER)
