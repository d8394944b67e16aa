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
_ARRAYS = ("alpha", "up", "support")
_SCALARS = tuple(f.name for f in dataclasses.fields(Evidence) if f.name not in _ARRAYS)
_BLOB = "_blob"  # evidence keeps the blob it was read from, so that writing it again costs nothing

# A row of JSON values, in the order of the fields. Rows that older versions wrote are shorter.
viewpoint_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Viewpoint)))
edge_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Edge)))


def viewpoint_of(row: Sequence[Any]) -> Viewpoint:
    """The viewpoint of a row. Raises one of ValueError, TypeError, IndexError on anything else."""
    x, y, z = row[1]
    return Viewpoint(row[0], (x, y, z), *row[2:])


def edge_of(row: Sequence[Any]) -> Edge:
    """The edge of a row. Raises TypeError on anything else."""
    return Edge(*row)


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
        header = json.loads(blob[5 : 5 + size])
        rows, cells = header.pop("shape")
        count = rows * cells
        data = zlib.decompress(blob[5 + size :])
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
        evidence.__dict__[_BLOB] = bytes(blob)
        return evidence
    except (struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError, zlib.error) as error:
        raise InputError(
            f"The stored evidence is damaged ({error}); build the graph again with `nvsim map`."
        ) from error


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
            index = json.loads(archive.read("graph.json"))
            data = archive.read("evidence.bin")
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
        return NavGraph(str(index["scan"]), viewpoints, edges, evidence, index.get("ignored", {}))
    except (zipfile.BadZipFile, zlib.error, ValueError, KeyError, IndexError, TypeError, EOFError) as error:
        raise InputError(f"The graph file is damaged ({error}); export it again.") from error


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
