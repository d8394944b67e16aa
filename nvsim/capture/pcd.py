"""The points of a PCD file (pointclouds.org's format 0.7): ascii, binary, and binary_compressed with LZF."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from nvsim.capture.point_table import Columns, ascii_table
from nvsim.capture.raw import whole_number
from nvsim.errors import InputError

_KINDS = {("F", 4): "f4", ("F", 8): "f8"} | {(t, s): f"{t.lower()}{s}" for t in "IU" for s in (1, 2, 4, 8)}
_LARGEST_EXPANSION = 100  # LZF turns 3 bytes into 264 at best


def parse(path: Path, data: bytes) -> Columns:
    """The columns with count 1: name -> (N,) values. Raises InputError naming the file if it is invalid."""
    header, start, lines = _header(path, data)
    names = header.get("FIELDS", [])
    try:
        sizes = [whole_number(v) for v in header["SIZE"]]
        counts = [whole_number(v) for v in header.get("COUNT", ["1"] * len(names))]
        if "POINTS" in header:
            rows = whole_number(header["POINTS"][0])
        else:
            rows = whole_number(header["WIDTH"][0]) * whole_number(header["HEIGHT"][0])
        kinds = [_KINDS[t, s] for t, s in zip(header["TYPE"], sizes, strict=True)]
        mode = header["DATA"][0]
        if (
            not (len(names) == len(kinds) == len(counts))
            or rows < 0
            or min(counts, default=1) < 1
            or max(counts) > 4096
        ):
            raise ValueError("fields disagree")
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"{path} has a header whose FIELDS, SIZE, TYPE, COUNT do not fit; export it again.") from error
    fields = [(f"{name}#{i}", kind, (count,)) for i, (name, kind, count) in enumerate(zip(names, kinds, counts))]
    layout = np.dtype(fields)
    body = data[start:]
    columns: Columns
    if mode == "ascii":
        table = ascii_table(path, body, rows, sum(counts), lines + 1)
        at = np.cumsum([0, *counts])
        columns = {}
        for i, name in enumerate(names):
            column = table[:, at[i]]
            if kinds[i][0] != "f":
                column = np.clip(column, -(2.0**31), 2.0**32 - 1).astype(np.int64).astype(np.uint32)
            columns[name] = column.astype(np.float32) if kinds[i] == "f4" else column
        return columns
    if mode == "binary_compressed":
        body = _decompress(path, body, rows * layout.itemsize)
    elif mode != "binary":
        raise InputError(f"{path} has DATA {mode[:20]!r}; it must be ascii, binary or binary_compressed.")
    if rows * layout.itemsize > len(body):
        present = len(body) // layout.itemsize
        raise InputError(f"{path} is truncated: {rows} points announced, {present} present; copy it again.")
    columns = {}
    at_byte = 0
    table_bytes = np.frombuffer(body, layout, rows) if mode == "binary" else None
    for i, name in enumerate(names):
        if table_bytes is not None:
            columns[name] = table_bytes[f"{name}#{i}"][:, 0]
        else:  # compressed files store one whole column after the other
            columns[name] = np.frombuffer(body, kinds[i], rows * counts[i], at_byte).reshape(rows, counts[i])[:, 0]
            at_byte += rows * counts[i] * sizes[i]
    return columns


def _header(path: Path, data: bytes) -> tuple[dict[str, list[str]], int, int]:
    """The words of the header by key, the byte at which the data begins, and the number of header lines."""
    header: dict[str, list[str]] = {}
    at = 0
    for line in range(1, 64):
        end = data.find(b"\n", at)
        if end < 0:
            break
        words = data[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
            if words[0] == "DATA":
                return header, at, line
    raise InputError(f"{path} has no DATA line, so its header is truncated; copy it again.")


def _decompress(path: Path, body: bytes, expected: int) -> bytes:
    if len(body) < 8:
        raise InputError(f"{path} is truncated in its compressed data; copy it again.")
    packed, unpacked = struct.unpack_from("<II", body)
    if packed > len(body) - 8:
        raise InputError(f"{path} is truncated: {packed} bytes announced, {len(body) - 8} present; copy it again.")
    if unpacked != expected or unpacked > packed * _LARGEST_EXPANSION:
        raise InputError(f"{path} is broken: its compressed data does not fit its number of points; copy it again.")
    result = lzf_decompress(body[8 : 8 + packed], unpacked)
    if result is None:
        raise InputError(f"{path} is broken: its compressed data cannot be unpacked; copy it again.")
    return result


def lzf_decompress(packed: bytes, size: int) -> bytes | None:
    """The LZF data `packed` decompressed; None if it is not LZF or does not give `size` bytes.

    A control byte below 32 is followed by that number + 1 literal bytes. Any other control byte starts a back
    reference: 3 bits of length (7: one more byte) and 13 bits of distance."""
    out = bytearray()
    at, end = 0, len(packed)
    while at < end and len(out) <= size:
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7 and at < end:
            length += packed[at]
            at += 1
        if at >= end:
            return None
        source = len(out) - (((control & 31) << 8) | packed[at]) - 1
        at += 1
        length += 2
        if source < 0:
            return None
        chunk = bytes(out[source : source + length])
        out += (chunk * (length // len(chunk) + 1))[:length]
    return bytes(out) if len(out) == size and at <= end else None
