"""Read the points of a PLY file: ascii, binary little-endian, or binary big-endian. All other elements are skipped."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nvsim.capture.point_table import Columns, ascii_table
from nvsim.errors import InputError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_LONGEST_HEADER = 1_000_000  # bytes
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    has_list: bool = False


@dataclass(frozen=True)
class BinaryRows:
    """Layout of the points in a binary file: `count` records of `layout`, the first at byte `start`."""

    start: int
    count: int
    layout: np.dtype[np.void]


def binary_rows(path: Path, begin: bytes, size: int) -> BinaryRows | None:
    """The layout from the bytes `begin`, which hold the header, of a file of `size` bytes; None for an ascii file.

    Raises InputError naming the file (and the line, in the header) if it is invalid or shorter than announced."""
    start, order, skipped, element, _ = _points(path, begin)
    if order == "=":
        return None
    layout = _layout(path, element, order)
    start += sum(e.count * _layout(path, e, order).itemsize for e in skipped)
    if start + element.count * layout.itemsize > size:
        present = max(0, size - start) // layout.itemsize
        raise InputError(f"{path} is truncated: {element.count} points announced, {present} present; copy it again.")
    return BinaryRows(start, element.count, layout)


def text_rows(path: Path, begin: bytes) -> tuple[int, int, int, int, tuple[str, ...]]:
    """The layout of the points of an ascii file from the bytes `begin`, which hold the header: its first byte after the
    header, the lines of the header, the lines before the points, the number of points, and the names of their columns.

    Raises InputError naming the file and the line of the header that is invalid."""
    start, _, skipped, element, lines = _points(path, begin)
    return start, lines + 1, sum(e.count for e in skipped), element.count, tuple(name for name, _ in element.properties)


def parse(path: Path, data: bytes) -> Columns:
    """The columns of the element `vertex`: name -> (N,) values. Raises InputError naming the file, and the line if the
    error is in the header."""
    rows = binary_rows(path, data, len(data))
    if rows is None:
        start, _, skipped, element, lines = _points(path, data)
        return _ascii(path, data[start:], element, sum(e.count for e in skipped), lines + 2)
    table = np.frombuffer(data, rows.layout, rows.count, rows.start)
    return {name: table[name].astype(table[name].dtype.newbyteorder("=")) for name in rows.layout.names or ()}


def _points(path: Path, data: bytes) -> tuple[int, str, list[_Element], _Element, int]:
    """The byte after the header, byte order, elements before `vertex`, `vertex`, and the number of header lines."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    start = data.find(b"\n", end) + 1
    if end < 0 or start == 0:
        raise InputError(f"{path} has no end_header, so its header is truncated; copy it again.")
    lines = data[:end].decode("ascii", "replace").splitlines()
    order, elements = _header(path, lines)
    skipped = []
    for element in elements:
        if element.name == "vertex":
            break
        skipped.append(element)
    else:
        raise InputError(f"{path} has no element 'vertex', so no points; export it as a point cloud.")
    if any(e.has_list and e.count for e in (*skipped, element)):
        raise InputError(
            f"{path} has a list property in or before its points, which is not supported; export plain points."
        )
    if not element.properties:
        raise InputError(f"{path} has points without properties; export it with x, y and z.")
    return start, order, skipped, element, len(lines)


def _ascii(path: Path, body: bytes, element: _Element, skip: int, first_line: int) -> Columns:
    at = 0
    for _ in range(skip):
        at = body.find(b"\n", at) + 1
        if at == 0:
            raise InputError(f"{path} ends before its points; copy it again.")
    body = body[at:]
    table = ascii_table(path, body, element.count, len(element.properties), first_line + skip)
    # Whole numbers stay integers, which distinguishes colors from 0 to 255 from colors from 0 to 1.
    columns: Columns = {}
    for i, (name, kind) in enumerate(element.properties):
        columns[name] = table[:, i] if kind.startswith("f") else np.clip(table[:, i], -(2**31), 2**32).astype(np.int64)
    return columns


def _layout(path: Path, element: _Element, order: str) -> np.dtype[np.void]:
    try:
        return np.dtype([(name, order + kind) for name, kind in element.properties])
    except ValueError as error:
        raise InputError(f"{path} lists a property of '{element.name}' twice; export it again.") from error


def _header(path: Path, lines: list[str]) -> tuple[str, list[_Element]]:
    order = None
    elements: list[_Element] = []
    for number, line in enumerate(lines[1:], 2):
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, _] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 16:
                elements.append(_Element(name, int(count)))
            case ["property", "list", size, kind, _] if size in _TYPES and kind in _TYPES and elements:
                elements[-1].has_list = True
            case ["property", kind, name] if kind in _TYPES and elements:
                elements[-1].properties.append((name, _TYPES[kind]))
            case _:
                raise InputError(f"{path}, line {number}: {line[:60]!r} is not a PLY header line; export it again.")
    if order is None:
        raise InputError(f"{path} does not say its format (ascii or binary); export it again.")
    return order, elements
