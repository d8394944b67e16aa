"""Damage inside compressed files (zip, npz, gzip, the evidence of an edge), and decompression bombs."""

from __future__ import annotations

import functools
import gzip
import io
import json
import struct
import zipfile
import zlib

import numpy as np

from fuzzing import pictures, trees
from fuzzing.damage import Damage

_BOMB = 128 << 20
"""Size of a decompressed bomb, bytes."""


def inner(d: Damage, name: str, data: bytes) -> bytes:
    """Damages a member according to its type."""
    if data[:6] == b"\x93NUMPY":
        return array(d, data)
    if data[:1] in (b"{", b"[") and name != "about.npy":
        return trees.json_tree(d, data)
    if data[:4] in (b"RIFF", b"\x89PNG"):
        return pictures.picture(d, data)
    return d.bytes(data)


def zipped(d: Damage, data: bytes) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(i.filename, archive.read(i), i.compress_type) for i in archive.infolist()]
    except Exception:  # an earlier change made the archive unreadable
        return d.bytes(data)
    if not members or d.dice.random() < 0.15:
        return d.bytes(data)
    k = d.dice.randrange(len(members))
    name, content, method = members[k]
    what = d.dice.choice(("inner",) * 8 + ("gone", "twice", "renamed", "bomb"))
    d.say(f"{what} {name}")
    if what == "inner":
        members[k] = (name, inner(d, name, content), method)
    elif what == "gone":
        del members[k]
    elif what == "twice":
        members.append((name, content[: len(content) // 2], method))
    elif what == "renamed":
        members[k] = (d.word().replace("\0", "_") or "_", content, method)
    else:
        return _with_bomb(members, k)
    return _archive(members)


def _archive(members: list[tuple[str, bytes, int]]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content, method in members:
            entry = zipfile.ZipInfo(name.encode("utf-8", "replace").decode()[:60_000], (1980, 1, 1, 0, 0, 0))
            try:
                archive.writestr(entry, content, method, compresslevel=1)
            except (NotImplementedError, UnicodeError, RuntimeError):
                archive.writestr("other", content)
    return out.getvalue()


def array(d: Damage, data: bytes) -> bytes:
    """Damages an .npy file: another header for the stored numbers, other numbers, another type or shape."""
    try:
        values = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception:
        return d.bytes(data)
    what = d.dice.choice(("bytes", "header", "header", "numbers", "type", "shape", "json"))
    if what == "json" and values.dtype == np.uint8 and values.ndim == 1 and values[:1].tobytes() in (b"{", b"["):
        return _saved(np.frombuffer(trees.json_tree(d, values.tobytes()), np.uint8))
    d.say(f"npy {what}")
    if what == "header":
        return _with_shape(d, data)
    if what == "numbers" and values.size and values.dtype.kind in "fiu":
        flat = values.ravel().copy()
        with np.errstate(all="ignore"):
            some = np.array(d.dice.choice((0, -1, 1e9, np.nan, np.inf, 2**62, 1e300))).astype(flat.dtype)
        flat[d.dice.randrange(flat.size) :: d.dice.choice((1, 7, flat.size))] = some
        return _saved(flat.reshape(values.shape))
    if what == "type":
        with np.errstate(all="ignore"):
            kind = d.dice.choice((np.float64, np.int8, np.uint64, np.complex128, bool, "U4", "S3", ">f4", "M8[s]"))
            try:
                return _saved(values.astype(kind))
            except (ValueError, TypeError):
                return _saved(np.array("x"))
    if what == "shape":
        shapes = (values.reshape(-1), values[None], values[..., None], values.reshape(-1)[:1], values.reshape(-1)[:0])
        return _saved(d.dice.choice((*shapes, values.reshape(-1)[:0].reshape(0, 3), values.T, np.array(1.0))))
    return d.bytes(data)


def _saved(values: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, values, allow_pickle=False)
    return out.getvalue()


def _with_shape(d: Damage, data: bytes) -> bytes:
    size = struct.unpack_from("<H", data, 8)[0]
    body = data[10 + size :]
    shape = d.dice.choice(
        (
            "(-1,)",
            "(0,)",
            "(2147483648,)",
            "(4294967296, 4294967296)",
            "(1000000000,)",
            "(3000000, 1000)",
            "()",
            "(1.5,)",
        )
        + ("(" * 3000, "(9223372036854775807, 2)", "(" + "9" * 5000 + ",)", "None", "(1,) * 99", "((1,),)")
    )
    kind = d.dice.choice(("'<f4'", "'<f8'", "'|u1'", "'|O'", "'<U1000000000'", "[('a', '<f4')]", "'|b1'", "'V8'", "5"))
    order = d.dice.choice(("False", "False", "True", "1", "None"))
    header = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    d.say(f"npy {shape[:30]} {kind}")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + body


@functools.cache
def _zeros() -> tuple[bytes, int]:
    """The compressed zeros of a bomb, and their CRC."""
    press, block, out, check = zlib.compressobj(1, zlib.DEFLATED, -15), bytes(1 << 20), [], 0
    for _ in range(_BOMB >> 20):
        out.append(press.compress(block))
        check = zlib.crc32(block, check)
    return b"".join([*out, press.flush()]), check


def prepare() -> None:
    """Prepares slow data once for all workers."""
    _zeros()


def _with_bomb(members: list[tuple[str, bytes, int]], k: int) -> bytes:
    """The archive with zeros instead of a member. It is built by hand: compressing the zeros again takes a second."""
    deflated, check = _zeros()
    body, directory = b"", b""
    for i, (name, content, _) in enumerate(members):
        title = name.encode()
        stored, crc, size, method = (
            (deflated, check, _BOMB, 8) if i == k else (content, zlib.crc32(content), len(content), 0)
        )
        fields = struct.pack("<HHHHHIIIHH", 20, 0, method, 0, 33, crc, len(stored), size, len(title), 0)
        directory += b"PK\1\2" + struct.pack("<H", 20) + fields + struct.pack("<HHHII", 0, 0, 0, 0, len(body)) + title
        body += b"PK\3\4" + fields + title + stored
    end = struct.pack("<HHHHIIH", 0, 0, len(members), len(members), len(directory), len(body), 0)
    return body + directory + b"PK\5\6" + end


def gzipped(d: Damage, data: bytes) -> bytes:
    if d.dice.random() < 0.2:
        return d.bytes(data)
    try:
        content = gzip.decompress(data)
    except Exception:
        return d.bytes(data)
    if d.dice.random() < 0.03:
        d.say("gzip bomb")
        head = zlib.compressobj(1, zlib.DEFLATED, -15)
        start = head.compress(content) + head.flush(zlib.Z_FULL_FLUSH)
        deflated, _ = _zeros()
        return b"\x1f\x8b\x08\0\0\0\0\0\0\xff" + start + deflated + struct.pack("<II", 0, _BOMB & 0xFFFFFFFF)
    return gzip.compress(d.bytes(content), 1, mtime=0)


def evidence(d: Damage, data: bytes) -> bytes:
    """Damages the evidence of an edge: a version byte, a JSON header with its length, and compressed cells."""
    size = int.from_bytes(data[1:5], "little")
    header, cells = data[5 : 5 + size], data[5 + size :]
    draw = d.dice.random()
    try:
        if draw < 0.5:
            json.loads(header)
            header = trees.json_tree(d, header)
        elif draw < 0.75:
            cells = zlib.compress(d.bytes(zlib.decompress(cells)), 1)
        elif draw < 0.78:
            d.say("evidence bomb")
            cells = b"\x78\x01" + _zeros()[0]
        else:
            return d.bytes(data)
    except (ValueError, zlib.error, RecursionError):
        return d.bytes(data)
    return data[:1] + struct.pack("<I", len(header)) + header + cells


def deflated(d: Damage, data: bytes) -> bytes:
    """Damages the content of a zlib stream that starts in the first bytes, as JSON if it is JSON."""
    for at in range(min(16, len(data))):
        try:
            content = zlib.decompress(data[at:])
        except zlib.error:
            continue
        if d.dice.random() < 0.04:
            d.say("zlib bomb")
            return data[:at] + b"\x78\x01" + _zeros()[0]
        return data[:at] + zlib.compress(inner(d, "", content), 1)
    return inner(d, "", data)
