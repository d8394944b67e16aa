"""Check the external weight files of an ONNX file before a library opens them.

An ONNX file can name another file that holds a tensor (`external_data`). A foreign ONNX file could name any file of the
user, or a pipe that is never written. This module reads the names without the package onnx. It decodes only the fields
of the Protocol Buffers encoding that lead to a tensor.
Source: onnx.proto (github.com/onnx/onnx), protobuf.dev/programming-guides/encoding, ONNX "External Data".
"""

from __future__ import annotations

import mmap
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

from nvsim.errors import InputError, value_text
from nvsim.files.opening import opened, size_of

_THEN = "export it again"
_MESSAGES: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
}
"""Fields of each message that lead to a tensor, by number."""
_DIMS, _NAME, _EXTERNAL_DATA, _LOCATION = 1, 8, 13, 14
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_MOST_DEPTH = 200
_SHORT = 4096  # bytes of a name or of an external data entry


@dataclass
class ExternalTensor:
    """A tensor in another file, as described in the ONNX file. `said` holds all entries: location, offset, length."""

    name: str = ""
    said: list[tuple[str, str]] = field(default_factory=list)
    is_external: bool = False


def check_external_data(path: Path) -> int:
    """Total bytes of the ONNX file at `path` and of its external weight files.

    Raises InputError if it is not an ONNX file. Also raises InputError if a weight file is outside its folder (an
    absolute path, "..", or a link), is not a regular file, is missing, or is too short.
    """
    with opened(path) as file:
        total = size_of(file)
        if not total:
            raise InputError(f"{path} is empty; copy it again.")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            try:
                found = list(_tensors(data))
            except (ValueError, IndexError) as error:
                raise InputError(f"{path} cannot be loaded as an ONNX network ({error}); {_THEN}.") from error
    sizes: dict[Path, int] = {}
    for tensor in found:
        _check(path, tensor, sizes)
    return total + sum(sizes.values())


def _check(path: Path, tensor: ExternalTensor, sizes: dict[Path, int]) -> None:
    """Raises InputError unless the file of a tensor may be opened. Otherwise adds its size to `sizes`."""
    about = f"{path}: the weights {value_text(tensor.name)}"
    said = dict(tensor.said)
    if len(said) != len(tensor.said) or not said.get("location"):
        raise InputError(f"{about} do not name exactly one file; {_THEN}.")
    location = said["location"]
    parts = PurePosixPath(location).parts
    outside = PurePosixPath(location).is_absolute() or PureWindowsPath(location).drive or ".." in parts
    if outside or "\\" in location or "*" in location or not location.isprintable():
        raise InputError(
            f"{about} refer to {value_text(location)!r}; only a file in the folder of the network is opened. "
            f"Export it with the weights beside it."
        )
    file = path.parent / location
    try:
        real = os.path.realpath(file)
        known = os.stat(real)
    except (OSError, ValueError) as error:
        reason = "is missing" if isinstance(error, FileNotFoundError) else "cannot be read"
        raise InputError(
            f"{path} needs the file {value_text(location)} beside it, which {reason}; copy it there."
        ) from error
    # A download cache has links to files in one folder. There, the weights are beside the target of the network's link.
    folders = {os.path.realpath(path.parent), os.path.dirname(os.path.realpath(path))}
    if not any(Path(real).is_relative_to(folder) for folder in folders):
        raise InputError(
            f"{about} are in {value_text(location)}, a link to a file in another folder; put the file itself beside "
            f"{path.name}."
        )
    if not stat.S_ISREG(known.st_mode):
        raise InputError(
            f"{about} are in {value_text(location)}, which is not a regular file; copy the weights file there."
        )
    try:
        offset, length = (int(said.get(key) or 0) for key in ("offset", "length"))
        if min(offset, length) < 0:
            raise ValueError
    except ValueError as error:
        raise InputError(f"{about} have an offset or a length that is not a number of bytes; {_THEN}.") from error
    if offset + length > known.st_size:
        raise InputError(
            f"{about} end at byte {offset + length} of {value_text(location)}, which has {known.st_size}; "
            "copy it again."
        )
    sizes[Path(real)] = known.st_size


# The encoding --------------------------------------------------------------------------------------------------------


def _tensors(data: mmap.mmap) -> Iterator[ExternalTensor]:
    """The tensors of a model in other files. Raises ValueError or IndexError if `data` is not a message."""
    left = [("model", 0, len(data), 0)]
    while left:
        kind, start, end, depth = left.pop()
        if depth > _MOST_DEPTH:
            raise ValueError("it is nested too deeply")
        if kind == "tensor":
            tensor = _tensor(data, start, end)
            if tensor.is_external:
                yield tensor
            continue
        within = _MESSAGES[kind]
        for number, wire, at, to in _fields(data, start, end):
            if wire == _BYTES and number in within:
                left.append((within[number], at, to, depth + 1))


def _tensor(data: mmap.mmap, start: int, end: int) -> ExternalTensor:
    found = ExternalTensor()
    for number, wire, at, to in _fields(data, start, end):
        if number == _LOCATION and wire == _VARINT:
            found.is_external |= _varint(data, at, to)[0] != 0
        elif number == _NAME and wire == _BYTES:
            found.name = data[at : min(to, at + _SHORT)].decode("utf-8", "replace")
        elif number == _EXTERNAL_DATA and wire == _BYTES:
            found.is_external = True
            found.said.append(_entry(data, at, to))
    return found


def _entry(data: mmap.mmap, start: int, end: int) -> tuple[str, str]:
    if end - start > _SHORT:
        raise ValueError("the name of a weights file is too long")
    said = {1: "", 2: ""}
    for number, wire, at, to in _fields(data, start, end):
        if wire == _BYTES and number in said:
            said[number] = data[at:to].decode("utf-8", "surrogateescape")
    return said[1], said[2]


def _fields(data: mmap.mmap, start: int, end: int) -> Iterator[tuple[int, int, int, int]]:
    """(number, wire type, first byte of the value, byte after it) of the fields of a message."""
    at = start
    while at < end:
        tag, at = _varint(data, at, end)
        number, wire = tag >> 3, tag & 7
        first = at
        if wire == _VARINT:
            _, at = _varint(data, at, end)
        elif wire == _FIXED64:
            at += 8
        elif wire == _FIXED32:
            at += 4
        elif wire == _BYTES:
            length, first = _varint(data, at, end)
            at = first + length
        else:
            raise ValueError(f"byte {first} does not start a field of an ONNX file")
        if number == 0 or at > end:
            raise ValueError(f"it ends in the middle of a field, at byte {end}" if number else "it has a field 0")
        yield number, wire, first, at


def _varint(data: mmap.mmap, at: int, end: int) -> tuple[int, int]:
    """A number and the position after it."""
    value = shift = 0
    while True:
        if at >= end or shift > 63:
            raise ValueError(f"byte {at} is not the end of a number")
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
