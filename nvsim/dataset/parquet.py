"""Write a table of numbers as a Parquet file, without compression, in one row group with one page per column.

Source: github.com/apache/parquet-format, README.md, Encodings.md, LogicalTypes.md, and parquet.thrift; the metadata is
in Thrift's compact protocol.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim import __version__

_MAGIC = b"PAR1"
_I32, _I64, _TEXT, _LIST, _STRUCT = 5, 6, 8, 9, 12  # types of Thrift's compact protocol
_TYPES = {"int64": 2, "float64": 5}
_PLAIN, _RLE = 0, 3  # encodings
_REQUIRED, _REPEATED = 0, 2
_AS_LIST = 3  # converted type

Field = tuple[int, bytes]
"""A value in Thrift's compact protocol: its type and its bytes."""


def parquet_bytes(columns: Mapping[str, NDArray[Any]]) -> bytes:
    """Returns the file. Columns are int64 or float64 arrays with the same number of rows, at least one: (N,) numbers,
    (N, A) lists, or (N, A, B) lists of lists.

    Raises ValueError if there is no row, or a column has another type or another number of rows.
    """
    rows = {len(values) for values in columns.values()}
    if len(rows) != 1 or 0 in rows:
        raise ValueError("columns need the same number of rows, at least one")
    (count,) = rows
    file, schema, chunks, whole = bytearray(_MAGIC), [_element("schema", children=len(columns))], [], 0
    for name, values in columns.items():
        if values.dtype.name not in _TYPES:
            raise ValueError(f"column {name} is {values.dtype.name}, not int64 or float64")
        kind, path = _TYPES[values.dtype.name], [name, *["list", "element"] * (values.ndim - 1)]
        schema += _elements(path, kind)
        page, begin = _page(values), len(file)
        file += page
        whole += len(page)
        about = {1: _i32(kind), 2: _list(_I32, [_i32(_PLAIN), _i32(_RLE)]), 3: _list(_TEXT, [_text(p) for p in path])}
        about |= {4: _i32(0), 5: _i64(values.size), 6: _i64(len(page)), 7: _i64(len(page)), 9: _i64(begin)}
        chunks.append(_struct({2: _i64(begin), 3: _struct(about)}))
    group = _struct({1: _list(_STRUCT, chunks), 2: _i64(whole), 3: _i64(count)})
    footer = {1: _i32(1), 2: _list(_STRUCT, schema), 3: _i64(count), 4: _list(_STRUCT, [group])}
    tail = _struct({**footer, 6: _text(f"nvsim {__version__}")})[1]
    return bytes(file) + tail + struct.pack("<I", len(tail)) + _MAGIC


def _elements(path: Sequence[str], kind: int) -> list[Field]:
    """The schema of a column. A list is a group with a repeated group `list`, which has the field `element`."""
    found = []
    for name in path[:-1]:
        repeated = name == "list"
        found.append(_element(name, _REPEATED if repeated else _REQUIRED, 1, None if repeated else _AS_LIST))
    return [*found, _element(path[-1], _REQUIRED, kind=kind)]


def _element(
    name: str, repetition: int | None = None, children: int = 0, converted: int | None = None, kind: int | None = None
) -> Field:
    values = {1: kind, 3: repetition, 5: children or None, 6: converted}
    fields = {key: _i32(value) for key, value in values.items() if value is not None}
    return _struct(dict(sorted({**fields, 4: _text(name)}.items())))


def _page(values: NDArray[Any]) -> bytes:
    levels = b""
    if values.ndim > 1:
        # The repetition level of a value is 0 if a row begins, 1 if a list in the row continues, and so on.
        sizes = np.cumprod(values.shape[:0:-1])[::-1]
        starts = np.arange(values.size)[:, None] % sizes == 0
        repetition = values.ndim - 1 - starts.sum(axis=1)
        levels = _levels(repetition) + _levels(np.full(values.size, values.ndim - 1))
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    data = levels + little.tobytes()
    about = _struct({1: _i32(values.size), 2: _i32(_PLAIN), 3: _i32(_RLE), 4: _i32(_RLE)})
    return _struct({1: _i32(0), 2: _i32(len(data)), 3: _i32(len(data)), 5: about})[1] + data


def _levels(levels: NDArray[Any]) -> bytes:
    """Levels (N,) as runs of equal values, after their length in bytes."""
    begins = np.flatnonzero(np.r_[True, levels[1:] != levels[:-1]])
    counts = np.diff(np.r_[begins, len(levels)])
    runs = b"".join(_varint(int(n) << 1) + bytes([int(levels[k])]) for k, n in zip(begins, counts, strict=True))
    return struct.pack("<I", len(runs)) + runs


def _varint(value: int) -> bytes:
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def _i32(value: int) -> Field:
    return _I32, _varint(value << 1)


def _i64(value: int) -> Field:
    return _I64, _varint(value << 1)


def _text(value: str) -> Field:
    data = value.encode()
    return _TEXT, _varint(len(data)) + data


def _list(kind: int, items: Sequence[Field]) -> Field:
    head = bytes([len(items) << 4 | kind]) if len(items) < 15 else bytes([0xF0 | kind]) + _varint(len(items))
    return _LIST, head + b"".join(data for _, data in items)


def _struct(fields: Mapping[int, Field]) -> Field:
    """Fields by increasing number."""
    data, before = bytearray(), 0
    for number, (kind, value) in fields.items():
        data += bytes([(number - before) << 4 | kind]) + value
        before = number
    return _STRUCT, bytes(data) + b"\0"
