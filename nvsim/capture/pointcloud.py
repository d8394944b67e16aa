"""Read a point cloud file into a Cloud: the points of a PCD file, and the steps that PCD and PLY share.

PCD is pointclouds.org's format 0.7: ascii, binary, and binary_compressed with LZF.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import ply
from nvsim.capture.findings import Findings
from nvsim.capture.point_table import Columns, ascii_table
from nvsim.capture.raw import FAR, FARTHEST, read_bytes, whole_number
from nvsim.capture.types import Cloud, CloudKind
from nvsim.errors import InputError
from nvsim.files.reading import reading

_COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


def read_cloud(path: Path, findings: Findings, kind: CloudKind = "lidar") -> Cloud:
    """The point cloud in a PLY or PCD file; its content decides the format.

    Raises InputError naming the file if it is empty, truncated, or of another format."""
    with reading(path, "a point cloud", "export it again"):
        return _read(path, findings, kind)


def _read(path: Path, findings: Findings, kind: CloudKind) -> Cloud:
    data = read_bytes(path)
    if data.startswith(b"ply"):
        columns = ply.parse(path, data)
    elif b"FIELDS" in data[:4096]:
        columns = parse_pcd(path, data)
    else:
        raise InputError(f"{path} is neither PLY nor PCD; convert the cloud to one of these.")
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path} has no point coordinate {', '.join(missing)}; export it with x, y and z.")
    with np.errstate(invalid="ignore"):  # a signaling NaN is another point that is skipped
        points = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
    return usable_cloud(points, _colors(columns), kind, path.name, findings)


def usable_cloud(
    points: NDArray[np.float64], colors: NDArray[np.uint8] | None, kind: CloudKind, where: str, findings: Findings
) -> Cloud:
    """A point cloud of the `points` (N, 3) that are finite and plausibly near; a warning counts the skipped points.

    `points` and `colors` (N, 3) uint8 RGB are in the unit and frame of the source."""
    good = np.asarray((np.abs(np.nan_to_num(points, nan=np.inf)) < FARTHEST).all(axis=1))
    if not good.all():
        left_out = int(np.count_nonzero(~good))
        findings.warning(f"{left_out} of {len(good)} points are not finite or too far", where, "they are left out")
        points, colors = points[good], None if colors is None else colors[good]
    return Cloud(stored_points(points), colors, kind)


def stored_points(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points (N, 3) as stored in the point cloud of a RawCapture: float32, or float64 if they are far from the origin.

    Beyond 1000 units, float32 is too coarse. `subtract_origin` converts all points to float32."""
    if len(points) and np.abs(points).max() > FAR:
        return cast(NDArray[np.float32], points)
    return points.astype(np.float32)


def _colors(columns: Columns) -> NDArray[np.uint8] | None:
    """(N, 3) uint8 RGB from three columns (integers to 255 or 65535, or fractions of 1) or from PCD's packed column."""
    for names in _COLOR_NAMES:
        if all(name in columns for name in names):
            values = np.stack([columns[name] for name in names], axis=1)
            if values.dtype == np.uint16:
                return (values.astype(np.uint16) >> 8).astype(np.uint8)
            scale = 255.0 if values.dtype.kind == "f" else 1.0
            return np.clip(np.nan_to_num(values.astype(np.float64)) * scale, 0, 255).round().astype(np.uint8)
    packed = columns.get("rgb", columns.get("rgba"))
    if packed is None or packed.dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([(bits >> shift) & 255 for shift in (16, 8, 0)], axis=1).astype(np.uint8)


def merge(clouds: list[Cloud], voxel: float = 0.02, most: int = 4_000_000) -> Cloud | None:
    """All clouds in one; None if `clouds` is empty.

    Above `most` points, only the first point in each cube of `voxel` meters is kept, so that a day of LiDAR scans fits
    into memory."""
    if not clouds:
        return None
    points = np.concatenate([c.points for c in clouds])
    colors = None
    if all(c.colors is not None for c in clouds):
        colors = np.concatenate([c.colors for c in clouds if c.colors is not None])
    if len(points) > most:
        keys = np.floor((points - points.min(axis=0)) / voxel).astype(np.int64)
        keys = (keys[:, 0] << 42) | (keys[:, 1] << 21) | keys[:, 2]
        kept = np.sort(np.unique(keys, return_index=True)[1])
        points, colors = points[kept], None if colors is None else colors[kept]
    return Cloud(points, colors, clouds[0].kind)


_KINDS = {("F", 4): "f4", ("F", 8): "f8"} | {(t, s): f"{t.lower()}{s}" for t in "IU" for s in (1, 2, 4, 8)}
_LARGEST_EXPANSION = 100  # LZF turns 3 bytes into 264 at best


def parse_pcd(path: Path, data: bytes) -> Columns:
    """The columns with count 1: name -> (N,) values. Raises InputError naming the file if it is invalid."""
    header, start, lines = _pcd_header(path, data)
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


def _pcd_header(path: Path, data: bytes) -> tuple[dict[str, list[str]], int, int]:
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
