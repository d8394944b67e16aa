"""Encode graphs and evidence as bytes: one evidence as a compact blob for a database row, a whole graph as one blob.

An evidence blob is a version byte, the length of a JSON header (uint32, little endian), the header, and the deflated
cells. Version 1 holds alpha, up and support only. Version 2 adds other planes and a second opinion. Version 3 adds the
normals of a network and panorama views. Programs refuse versions that they do not know.

A graph blob is a zip with graph.json and evidence.bin. Floats are JSON numbers, which Python writes and reads without
loss.
"""

from __future__ import annotations

import dataclasses
import io
import itertools
import json
import math
import operator
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from nvsim.errors import InputError, value_text
from nvsim.files.opening import is_number
from nvsim.graph.types import Edge, Evidence, NavGraph, SecondOpinion, Viewpoint

T = TypeVar("T")
_VERSION = 1
_EVIDENCE_VERSIONS = (1, 2, 3)
_BLOCK = 256
_FAR = 1e12  # meters
_MOST_HEADER = 1 << 16  # bytes
_OPTIONAL = ("reach", "mass", "network_up")
_ARRAYS = ("alpha", "up", "support", *_OPTIONAL)
_SCALARS = tuple(f.name for f in dataclasses.fields(Evidence) if f.name not in (*_ARRAYS, "second"))
_CELLS_PER_BYTE = 256
"""Maximum cells per byte of an evidence blob. Blobs of NVSim have two, and twenty if all cells are equal."""
_FREE, _FREE_TEXT, _EXPANSION = 32 << 20, 4 << 20, 10
"""Limits of an unpacked graph blob in bytes: a base amount for the cells of all evidence, one for each file, and an
amount for each byte of the blob."""
_EVIDENCE: Mapping[str, type] = {
    **dict.fromkeys(("viewpoint", "joins", "decision", "views"), str),
    **dict.fromkeys(("heading", "length", "near", "depth", "width"), float),
    **dict.fromkeys(("direction", "submap"), int),
    "stale": bool,
}
_EDGE: Mapping[str, type] = {**dict.fromkeys(("a", "b", "origin"), str), "reviewed": bool, "locked": bool}
_VIEWPOINT: Mapping[str, type] = {
    **dict.fromkeys(("id", "origin"), str),
    **dict.fromkeys(("included", "reviewed", "locked"), bool),
    "height": float,
    "submap": int,
}
_BLOB = "_blob"  # attribute of evidence for the blob it was read from or written as, so that it is encoded only once

# Rows of JSON values in the order of the fields. Rows of older versions are shorter.
edge_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Edge)))
_whole_row = operator.attrgetter(*(f.name for f in dataclasses.fields(Viewpoint)))


def viewpoint_row(viewpoint: Viewpoint) -> tuple[Any, ...]:
    """Return the row of a viewpoint. A share that was not measured is omitted, as in earlier versions."""
    row: tuple[Any, ...] = _whole_row(viewpoint)
    return row[:-1] if viewpoint.photographed is None else row


def viewpoint_of(row: Sequence[Any]) -> Viewpoint:
    """Return the viewpoint of a row. Raises ValueError, TypeError or IndexError if the row is invalid."""
    x, y, z = row[1]
    found = Viewpoint(row[0], (x, y, z), *row[2:])
    texts, numbers = (found.id, found.origin), (x, y, z, found.height, found.submap)
    if not (_are(texts, str) and _are((found.included, found.reviewed, found.locked), bool) and found.id):
        raise ValueError("a viewpoint with values of a wrong type")
    if not all(type(n) in (int, float) and abs(n) < _FAR for n in numbers) or type(found.submap) is not int:
        raise ValueError(f"the viewpoint {found.id[:40]!r} has an invalid position")
    share = found.photographed
    if share is not None and not (type(share) in (int, float) and 0 <= share <= 1):
        raise ValueError(f"the viewpoint {found.id[:40]!r} has an invalid photographed share")
    return found


def edge_of(row: Sequence[Any]) -> Edge:
    """Return the edge of a row. Raises TypeError or ValueError if the row is invalid."""
    found = Edge(*row)
    if not _are((found.a, found.b, found.origin), str) or not _are((found.reviewed, found.locked), bool):
        raise ValueError("an edge with values of a wrong type")
    return found


def _are(values: Iterable[Any], kind: type) -> bool:
    return all(type(value) is kind for value in values)


def inflate(data: bytes, most: int) -> bytes:
    """Return the inflated bytes. Raises ValueError if there are more than `most` or the data ends too early, and
    zlib.error if the data is not deflated."""
    stream = zlib.decompressobj()
    found = stream.decompress(data, most)
    if not stream.eof:
        raise ValueError("it ends too early" if len(found) < most else f"it is larger than {most} bytes")
    return found


def encode_evidence(evidence: Evidence) -> bytes:
    """Encode evidence. A corridor of 29 x 18 cells takes about 300 bytes."""
    known: bytes | None = evidence.__dict__.get(_BLOB)
    if known is not None:
        return known
    header: dict[str, Any] = {name: getattr(evidence, name) for name in _SCALARS}
    header["shape"] = evidence.alpha.shape
    extra = [name for name in _OPTIONAL if getattr(evidence, name) is not None]
    planes = [evidence.alpha, evidence.up, *(getattr(evidence, name) for name in extra)]
    version = 1
    if evidence.views == "pitched":
        del header["views"]
    if extra or evidence.second is not None:
        version, header["planes"] = 2, extra
    if (second := evidence.second) is not None:
        header["second"] = second.submap, [name for name in _OPTIONAL if getattr(second, name) is not None]
        planes += [second.alpha, second.up, *(getattr(second, name) for name in header["second"][1])]
    if "views" in header or "network_up" in (*extra, *header.get("second", (0, ()))[1]):
        version = 3
    text = json.dumps(header, separators=(",", ":")).encode()
    raw = b"".join(plane.tobytes() for plane in planes) + np.packbits(evidence.support).tobytes()
    blob = struct.pack("<BI", version, len(text)) + text + zlib.compress(raw, level=6)
    evidence.__dict__[_BLOB] = blob
    return blob


def decode_evidence(blob: bytes) -> Evidence:
    """Decode evidence. Raises InputError if `blob` is damaged or comes from a newer version."""
    try:
        version, size = struct.unpack_from("<BI", blob)
        if version not in _EVIDENCE_VERSIONS:
            raise InputError(f"The evidence is of version {version}, newer than this program; install a newer NVSim.")
        if size > _MOST_HEADER:
            raise ValueError("the header is too long")
        header = json.loads(blob[5 : 5 + size])
        rows, cells = header.pop("shape")
        count = rows * cells
        if not (type(rows) is type(cells) is int and min(rows, cells) >= 0 and count <= _CELLS_PER_BYTE * len(blob)):
            raise ValueError(f"cells of shape {rows!r:.20} x {cells!r:.20}")
        own = ["alpha", "up", *_optional(header.pop("planes", []))]
        submap, extra = header.pop("second", (None, []))
        others = [] if submap is None else ["alpha", "up", *_optional(extra)]
        many = len(own) + len(others)
        data = _inflate(blob[5 + size :], many * count + (count + 7) // 8)
        planes = [np.frombuffer(data, np.uint8, count, k * count).reshape(rows, cells) for k in range(many)]
        support = np.unpackbits(np.frombuffer(data, np.uint8, offset=many * count), count=count).astype(bool)
        header["target"] = x, y = (float(header["target"][0]), float(header["target"][1]))
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError("a target that is not finite")
        if not header.keys() <= set(_SCALARS):
            raise ValueError("unknown keys in the header")
        _check_kinds(header, _EVIDENCE)
        if header.get("views", "panorama") != "panorama":
            raise ValueError("an unknown kind of views")
        if submap is not None:
            _check_kinds({"submap": submap}, _EVIDENCE)
            header["second"] = SecondOpinion(submap, **dict(zip(others, planes[len(own) :], strict=True)))
        header |= zip(own, planes[: len(own)], strict=True)
        evidence = Evidence(support=support.reshape(rows, cells), **header)
        evidence.__dict__[_BLOB] = bytes(blob)
        return evidence
    except InputError:
        raise
    except Exception as error:  # any error that invalid JSON or deflated bytes cause
        raise InputError(
            f"The stored evidence is damaged ({value_text(error)}); build the graph again with `nvsim map`."
        ) from error


def _optional(names: Any) -> tuple[str, ...]:
    """Return the names of the optional planes in a header, in our order. Raises ValueError for other names."""
    if not isinstance(names, list) or names != [name for name in _OPTIONAL if name in names]:
        raise ValueError(f"planes {names!r:.40}")
    return tuple(names)


def encode_graph(graph: NavGraph) -> bytes:
    """Encode a graph as one self-contained blob. `decode_graph` returns an equal graph."""
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
        # A fixed date gives equal bytes for equal graphs.
        for name, data, method in (
            ("graph.json", index, zipfile.ZIP_DEFLATED),
            ("evidence.bin", b"".join(blobs), zipfile.ZIP_STORED),  # already deflated
        ):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data, method, compresslevel=1)
    return out.getvalue()


def _rows(things: Iterable[T], row: Callable[[T], Any]) -> str:
    """Return a JSON list, encoded in blocks. One long call would block the other threads."""
    rest, blocks = iter(things), []
    while block := list(itertools.islice(rest, _BLOCK)):
        blocks.append(json.dumps(list(map(row, block)), separators=(",", ":"))[1:-1])
    return f"[{','.join(blocks)}]"


def decode_graph(blob: bytes) -> NavGraph:
    """Decode a graph. Raises InputError if `blob` is damaged or comes from a newer version."""
    try:
        with zipfile.ZipFile(io.BytesIO(blob)) as archive:
            _check_sizes(archive, len(blob))
            index = json.loads(archive.read("graph.json"))
            data = archive.read("evidence.bin")
        if index["version"] != _VERSION:
            version = value_text(index["version"])
            raise InputError(f"The graph file is of version {version}, newer than this program; install a newer NVSim.")
        viewpoints = {row[0]: viewpoint_of(row) for row in index["viewpoints"]}
        edges = {(row[0], row[1]): edge_of(row) for row in index["edges"]}
        if any(not (a < b and a in viewpoints and b in viewpoints) for a, b in edges):
            raise ValueError("an edge without its viewpoints")
        for viewpoint in viewpoints.values():
            _check_kinds(vars(viewpoint), _VIEWPOINT)
            if not all(is_number(v) for v in viewpoint.position):
                raise ValueError("a position that is not finite")
        for one in edges.values():
            _check_kinds(vars(one), _EDGE)
        ignored = index.get("ignored", {})
        if not all(isinstance(value, str) for value in ignored.values()):
            raise ValueError("ignored findings without reasons")
        evidence, at, held = {}, 0, 0
        for size in index["evidence"]:
            if not 0 < size <= len(data) - at:
                raise ValueError("evidence of a wrong size")
            found = decode_evidence(data[at : at + size])
            held += _planes_in(found) * found.alpha.size
            if held > _FREE + _EXPANSION * len(blob):
                raise ValueError("more evidence than its size allows")
            evidence[found.key] = found
            at += size
        return NavGraph(str(index["scan"]), viewpoints, edges, evidence, ignored)
    except InputError:
        raise
    except Exception as error:  # any error that an invalid archive or invalid JSON causes
        raise InputError(f"The graph file is damaged ({value_text(error)}); export it again.") from error


def _planes_in(evidence: Evidence) -> int:
    """Return how many arrays of its cells the evidence holds."""
    return sum(getattr(one, n, None) is not None for one in (evidence, evidence.second) for n in _ARRAYS)


def _check_sizes(archive: zipfile.ZipFile, size: int) -> None:
    """Raises ValueError if the files of an archive of `size` bytes would unpack to more than the limits allow."""
    for name in ("graph.json", "evidence.bin"):
        entry = archive.getinfo(name)
        if entry.compress_type not in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
            raise ValueError(f"{name} is packed in an unknown way")
        if entry.file_size > _FREE_TEXT + _EXPANSION * size:
            raise ValueError(f"{name} unpacks to {entry.file_size} bytes")


def _inflate(data: bytes, size: int) -> bytes:
    """Return deflated bytes that must be `size` long. Raises ValueError if they are not."""
    found = inflate(data, size + 1)
    if len(found) != size:
        raise ValueError("wrong number of cells")
    return found


def _check_kinds(values: Mapping[str, Any], kinds: Mapping[str, type]) -> None:
    """Raises ValueError if a value has another type or is not finite. An integer is accepted as a float."""
    for name, kind in kinds.items():
        if name not in values:
            continue
        value = values[name]
        good = type(value) is kind or (kind is float and type(value) is int)
        if not good or (kind is float and not abs(value) < _FAR):
            raise ValueError(f"{name} is {value!r:.40}")


def same_graph(a: NavGraph, b: NavGraph) -> bool:
    """Whether two graphs hold equal values in equal order."""
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
        and _same_opinion(a.second, b.second)
    )


def _same_opinion(a: SecondOpinion | None, b: SecondOpinion | None) -> bool:
    if a is None or b is None:
        return a is b
    planes = ("alpha", "up", *_OPTIONAL)
    return a.submap == b.submap and all(np.array_equal(getattr(a, n), getattr(b, n)) for n in planes)
