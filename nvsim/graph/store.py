"""Graphs and evidence as bytes: one evidence as a compact blob for a database row, a whole graph as one blob.

An evidence blob is a version byte, the length of a JSON header (uint32, little endian), the header, and the deflated
cells. A graph blob is a zip with graph.json and evidence.bin. Floats travel as JSON numbers, which Python writes so
that they come back equal to the last bit.
"""

from __future__ import annotations

import dataclasses
import io
import itertools
import json
import operator
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from nvsim.errors import InputError
from nvsim.graph.types import Edge, Evidence, NavGraph, Viewpoint

T = TypeVar("T")
_VERSION = 1
_BLOCK = 256
_FAR = 1e12  # metres
_MOST_CELLS = 1 << 20  # of a piece of evidence; a corridor has some 500
_MOST_HEADER = 1 << 16  # bytes
_MOST_INDEX, _MOST_EVIDENCE = 256 << 20, 1 << 30  # bytes of a graph's parts
_ARRAYS = ("alpha", "up", "support")
_SCALARS = tuple(f.name for f in dataclasses.fields(Evidence) if f.name not in _ARRAYS)
_BLOB = "_blob"  # evidence keeps the blob it was read from, so that writing it again costs nothing

# A row of JSON values, in the order of the fields. Rows that older versions wrote are shorter.
viewpoint_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Viewpoint)))
edge_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Edge)))


def viewpoint_of(row: Sequence[Any]) -> Viewpoint:
    """The viewpoint of a row. Raises one of ValueError, TypeError, IndexError on anything else."""
    x, y, z = row[1]
    found = Viewpoint(row[0], (x, y, z), *row[2:])
    texts, numbers = (found.id, found.origin), (x, y, z, found.height, found.submap)
    if not (_are(texts, str) and _are((found.included, found.reviewed, found.locked), bool) and found.id):
        raise ValueError("a viewpoint with values of a wrong type")
    if not all(type(n) in (int, float) and abs(n) < _FAR for n in numbers) or type(found.submap) is not int:
        raise ValueError(f"the viewpoint {found.id[:40]!r} at no place")
    return found


def edge_of(row: Sequence[Any]) -> Edge:
    """The edge of a row. Raises TypeError or ValueError on anything else."""
    found = Edge(*row)
    if not _are((found.a, found.b, found.origin), str) or not _are((found.reviewed, found.locked), bool):
        raise ValueError("an edge with values of a wrong type")
    return found


def _are(values: Iterable[Any], kind: type) -> bool:
    return all(type(value) is kind for value in values)


def inflated(data: bytes, most: int) -> bytes:
    """Deflated bytes as they were. Raises ValueError where that is more than `most` bytes, zlib.error where it is
    none."""
    stream = zlib.decompressobj()
    found = stream.decompress(data, most)
    if not stream.eof:
        raise ValueError("it ends too early" if len(found) < most else f"it is larger than {most} bytes")
    return found


def encode_evidence(evidence: Evidence) -> bytes:
    """About 300 bytes for a corridor of 29 x 18 cells."""
    known: bytes | None = evidence.__dict__.get(_BLOB)
    if known is not None:
        return known
    header: dict[str, Any] = {name: getattr(evidence, name) for name in _SCALARS}
    header["shape"] = evidence.alpha.shape
    text = json.dumps(header, separators=(",", ":")).encode()
    cells = zlib.compress(
        evidence.alpha.tobytes() + evidence.up.tobytes() + np.packbits(evidence.support).tobytes(), level=6
    )
    return struct.pack("<BI", _VERSION, len(text)) + text + cells


def decode_evidence(blob: bytes) -> Evidence:
    """Raises InputError when `blob` is not whole or comes from a newer version."""
    try:
        version, size = struct.unpack_from("<BI", blob)
        if version != _VERSION:
            raise InputError(f"The evidence is of version {version}, newer than this program; install a newer NVSim.")
        if size > _MOST_HEADER:
            raise ValueError("a header too long")
        header = json.loads(blob[5 : 5 + size])
        rows, cells = header.pop("shape")
        count = rows * cells
        if not (_are((rows, cells), int) and rows >= 0 and cells >= 0 and count <= _MOST_CELLS):
            raise ValueError("no number of cells")
        data = inflated(blob[5 + size :], 2 * count + (count + 7) // 8 + 1)
        if len(data) != 2 * count + (count + 7) // 8:
            raise ValueError("wrong number of cells")
        header["target"] = (float(header["target"][0]), float(header["target"][1]))
        evidence = Evidence(
            alpha=np.frombuffer(data, np.uint8, count).reshape(rows, cells),
            up=np.frombuffer(data, np.uint8, count, count).reshape(rows, cells),
            support=np.unpackbits(np.frombuffer(data, np.uint8, offset=2 * count), count=count)
            .astype(bool)
            .reshape(rows, cells),
            **header,
        )
        _check_evidence(evidence)
        evidence.__dict__[_BLOB] = bytes(blob)
        return evidence
    except (
        *(struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError, zlib.error),
        *(OverflowError, RecursionError),
    ) as error:
        raise InputError(
            f"The stored evidence is damaged ({error}); build the graph again with `nvsim map`."
        ) from error


def _check_evidence(evidence: Evidence) -> None:
    e = evidence
    numbers = (e.heading, e.length, e.near, e.depth, e.width, *e.target)
    if not (_are((e.viewpoint, e.joins, e.decision), str) and _are((e.direction, e.submap), int)):
        raise ValueError("values of a wrong type")
    if type(e.stale) is not bool or not all(type(n) in (int, float) and abs(n) < _FAR for n in numbers):
        raise ValueError("values that are no numbers")


def encode_graph(graph: NavGraph) -> bytes:
    """One self-contained blob; `decode_graph` gives an equal graph."""
    blobs = [encode_evidence(e) for e in graph.evidence.values()]
    small = {"version": _VERSION, "scan": graph.scan, "ignored": dict(graph.ignored)}
    index = "".join(
        (
            json.dumps(small, separators=(",", ":"))[:-1],
            *(',"viewpoints":', _rows(graph.viewpoints.values(), viewpoint_row)),
            *(',"edges":', _rows(graph.edges.values(), edge_row)),
            *(',"evidence":', _rows(map(len, blobs), int), "}"),
        )
    ).encode()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        # A fixed date makes equal graphs equal bytes.
        for name, data, method in (
            ("graph.json", index, zipfile.ZIP_DEFLATED),
            ("evidence.bin", b"".join(blobs), zipfile.ZIP_STORED),  # deflated already
        ):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data, method, compresslevel=1)
    return out.getvalue()


def _rows(things: Iterable[T], row: Callable[[T], Any]) -> str:
    """A JSON list, made in blocks: one long call would keep the interpreter from everybody else."""
    rest, blocks = iter(things), []
    while block := list(itertools.islice(rest, _BLOCK)):
        blocks.append(json.dumps(list(map(row, block)), separators=(",", ":"))[1:-1])
    return f"[{','.join(blocks)}]"


def decode_graph(blob: bytes) -> NavGraph:
    """Raises InputError when `blob` is not whole or comes from a newer version."""
    try:
        with zipfile.ZipFile(io.BytesIO(blob)) as archive:
            index = json.loads(_member(archive, "graph.json", _MOST_INDEX))
            data = _member(archive, "evidence.bin", _MOST_EVIDENCE)
        if index["version"] != _VERSION:
            raise InputError(
                f"The graph file is of version {index['version']}, newer than this program; install a newer NVSim."
            )
        viewpoints = {row[0]: viewpoint_of(row) for row in index["viewpoints"]}
        edges = {(row[0], row[1]): edge_of(row) for row in index["edges"]}
        if any(not (a < b and a in viewpoints and b in viewpoints) for a, b in edges):
            raise ValueError("an edge without its viewpoints")
        evidence, at = {}, 0
        for size in index["evidence"]:
            found = decode_evidence(data[at : at + size])
            evidence[found.key] = found
            at += size
        ignored = index.get("ignored", {})
        if not isinstance(ignored, dict) or not _are(ignored.values(), str):
            raise ValueError("reasons that are no texts")
        return NavGraph(str(index["scan"]), viewpoints, edges, evidence, ignored)
    except (
        *(zipfile.BadZipFile, zlib.error, ValueError, KeyError, IndexError, TypeError, EOFError, AttributeError),
        *(OverflowError, RecursionError, NotImplementedError, RuntimeError, struct.error),
    ) as error:
        raise InputError(f"The graph file is damaged ({error}); export it again.") from error


def _member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """A file of the archive. Raises ValueError where it is larger than `most` bytes, whatever the archive says."""
    with archive.open(name) as member:
        data = member.read(most + 1)
    if len(data) > most:
        raise ValueError(f"{name} is larger than {most} bytes")
    return data


def same_graph(a: NavGraph, b: NavGraph) -> bool:
    """Whether two graphs hold equal values in the same order."""
    if a.scan != b.scan or list(a.viewpoints.items()) != list(b.viewpoints.items()):
        return False
    if dict(a.ignored) != dict(b.ignored):
        return False
    if list(a.edges.items()) != list(b.edges.items()) or list(a.evidence) != list(b.evidence):
        return False
    return all(same_evidence(x, y) for x, y in zip(a.evidence.values(), b.evidence.values(), strict=True))


def same_evidence(a: Evidence, b: Evidence) -> bool:
    """Whether two pieces of evidence hold equal values."""
    return (
        a is b
        or all(getattr(a, n) == getattr(b, n) for n in _SCALARS)
        and all(np.array_equal(getattr(a, n), getattr(b, n)) for n in _ARRAYS)
    )
