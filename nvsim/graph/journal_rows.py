"""Encode the steps, deltas and selections of a history as bytes and JSON, and compute a digest of a graph as a file
holds it."""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from typing import Any

from nvsim.graph.difference import GraphDelta, Runs
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.graph.store import (
    decode_evidence,
    decode_graph,
    edge_of,
    edge_row,
    encode_evidence,
    inflate,
    viewpoint_of,
    viewpoint_row,
)
from nvsim.graph.types import NavGraph

_PARTS, _WHOLE = b"P", b"W"
_MOST = 256 << 20  # maximum size of an inflated step or selection in bytes


def encode_delta(delta: GraphDelta) -> bytes:
    """Encode a delta: kind, length of the deflated JSON (uint32, little endian), the JSON, the evidence."""
    blobs = [encode_evidence(e) for e in delta.evidence]
    values: dict[str, Any] = {
        "viewpoints": list(map(viewpoint_row, delta.viewpoints)),
        "edges": list(map(edge_row, delta.edges)),
        "evidence": [len(b) for b in blobs],
        "no_viewpoints": delta.no_viewpoints,
        "no_edges": delta.no_edges,
        "no_evidence": delta.no_evidence,
        "ignored": None if delta.ignored is None else dict(delta.ignored),
        "scan": delta.scan,
        "orders": delta.orders if any(delta.orders) else None,
    }
    # An empty `ignored` object means that no finding is ignored. The other values are omitted if they are empty.
    text = _pack({name: value for name, value in values.items() if value or (name == "ignored" and value is not None)})
    return b"".join([_PARTS, struct.pack("<I", len(text)), text, *blobs])


def decode_delta(data: bytes) -> GraphDelta:
    """Decode a delta. Raises ValueError, KeyError, TypeError, IndexError, zlib.error, struct.error or InputError if the
    data is invalid."""
    if data[:1] == _WHOLE:
        return GraphDelta(whole=decode_graph(data[1:]))  # version 1 stored no orders
    if data[:1] != _PARTS:
        raise ValueError("a step of an unknown kind")
    (size,) = struct.unpack_from("<I", data, 1)
    values = json.loads(inflate(data[5 : 5 + size], _MOST))
    evidence, at = [], 5 + size
    for length in values.get("evidence", ()):
        evidence.append(decode_evidence(data[at : at + length]))
        at += length
    no_viewpoints, ignored, scan = values.get("no_viewpoints", ()), values.get("ignored"), values.get("scan")
    texts = [*no_viewpoints, *(ignored or {}).values(), *([] if scan is None else [scan])]
    if not all(isinstance(text, str) for text in texts):
        raise ValueError("a step with values of a wrong type")
    return GraphDelta(
        tuple(map(viewpoint_of, values.get("viewpoints", ()))),
        tuple(map(edge_of, values.get("edges", ()))),
        tuple(evidence),
        tuple(no_viewpoints),
        tuple((a, b) for a, b in values.get("no_edges", ())),
        tuple((id, direction) for id, direction in values.get("no_evidence", ())),
        ignored,
        scan,
        _orders(values.get("orders", ((), (), ()))),
    )


def _orders(values: Any) -> tuple[Runs, Runs, Runs]:
    viewpoints, edges, evidence = (tuple((int(start), int(length)) for start, length in runs) for runs in values)
    return viewpoints, edges, evidence


def encode_selection(selection: GraphSelection) -> bytes:
    """Encode a selection, sorted, so that equal selections give equal bytes; b"" for an empty one."""
    return _pack([sorted(selection.viewpoints), sorted(selection.edges)]) if selection else b""


def decode_selection(data: bytes) -> GraphSelection:
    """Decode a selection. Raises like `decode_delta`."""
    if not data:
        return NOTHING
    viewpoints, edges = json.loads(inflate(data, _MOST))
    return GraphSelection(frozenset(viewpoints), frozenset((a, b) for a, b in edges))


def fingerprint(graph: NavGraph, *, plain: bool = False) -> str:
    """Return a digest of a graph as a file holds it: everything except the cells of the evidence and the photographed
    shares. `plain`: only the content of an R2R connectivity file."""
    if plain:
        viewpoints = [(v.id, *map(float, v.position), float(v.height), v.included) for v in graph.viewpoints.values()]
        held: list[Any] = [viewpoints, sorted(graph.edges)]
    else:
        viewpoints = [
            (v.id, *map(float, v.position), float(v.height), v.submap, v.included, v.origin, v.reviewed, v.locked)
            for v in graph.viewpoints.values()
        ]
        evidence = [(*key, e.joins, e.decision, e.stale) for key, e in graph.evidence.items()]
        held = [graph.scan, viewpoints, list(map(edge_row, graph.edges.values())), evidence, dict(graph.ignored)]
    return hashlib.blake2b(json.dumps(held, separators=(",", ":")).encode(), digest_size=16).hexdigest()


def _pack(values: Any) -> bytes:
    return zlib.compress(json.dumps(values, separators=(",", ":")).encode(), level=1)
