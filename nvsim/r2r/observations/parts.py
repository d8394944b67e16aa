"""Splits a graph that is too large for one scan into parts, at places with few edges such as doors.

R2R's files grow with the square of the number of viewpoints, and agents compute the shortest paths between all pairs. A
graph is halved by the second eigenvector of its Laplacian (Fiedler 1973): the cut has the fewest edges in relation to
the size of the smaller half.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.csv_text import csv_text
from nvsim.graph.types import NavGraph

_EVEN = 0.3  # smallest share of the viewpoints in the smaller half
LEAST = 10
"""Smallest allowed limit for the viewpoints of a part."""


def split(graph: NavGraph, most: int) -> list[NavGraph]:
    """Splits a graph into parts of at most `most` viewpoints with the edges inside them; the result is deterministic.

    The parts are named NAME-a, NAME-b and so on. A graph that is small enough is returned unchanged. A part that is cut
    out of one component is connected. Small components may share a part.

    Raises InputError if `most` is less than 10.
    """
    if most < LEAST:
        raise InputError(f"A scan cannot be limited to {most} viewpoints; give --max-viewpoints {LEAST} or more.")
    if len(graph.viewpoints) <= most:
        return [graph]
    pieces = _merge_small_parts(_pieces(graph, most), most)
    order = {id: i for i, id in enumerate(graph.viewpoints)}
    pieces.sort(key=lambda ids: min(order[id] for id in ids))
    return [_part(graph, f"{graph.scan}-{_letters(i)}", ids) for i, ids in enumerate(pieces)]


def write_parts(path: Path, parts: Iterable[NavGraph]) -> None:
    """Writes a CSV with the part and the position in meters of each viewpoint. Raises InputError if writing fails."""
    rows: list[tuple[str, ...]] = [("scan", "viewpoint", "x", "y", "z")]
    for part in parts:
        rows += ((part.scan, v.id, *(f"{value:.3f}" for value in v.position)) for v in part.viewpoints.values())
    atomic.write_text(path, csv_text(rows))


def _pieces(graph: NavGraph, most: int) -> list[list[str]]:
    import networkx as nx

    joined = nx.Graph()
    joined.add_nodes_from(graph.viewpoints)
    joined.add_edges_from(graph.edges)
    waiting = [joined.subgraph(ids) for ids in nx.connected_components(joined)]
    found: list[list[str]] = []
    while waiting:
        piece = waiting.pop()
        ids = [id for id in graph.viewpoints if id in piece]
        if len(ids) <= most:
            found.append(ids)
            continue
        half = _half(joined, ids)
        rest = [id for id in ids if id not in half]
        waiting += [joined.subgraph(c) for part in (half, rest) for c in nx.connected_components(joined.subgraph(part))]
    return found


def _half(joined: Any, ids: list[str]) -> set[str]:
    """Returns the ids of one half of a connected graph."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import eigsh

    index = {id: i for i, id in enumerate(ids)}
    pairs = np.array([(index[a], index[b]) for a, b in joined.edges(ids) if a in index and b in index])
    n = len(ids)
    adjacency = csr_matrix((np.ones(2 * len(pairs)), (pairs.ravel("F"), pairs[:, ::-1].ravel("F"))), shape=(n, n))
    degrees = np.asarray(adjacency.sum(axis=1)).ravel()
    # The eigenvector of the second smallest eigenvalue of L is that of the second largest of 2 max(degree) I - L.
    shifted = csr_matrix((2 * degrees.max() - degrees, (np.arange(n), np.arange(n))), shape=(n, n)) + adjacency
    values, vectors = eigsh(shifted, k=2, which="LA", v0=np.cos(np.arange(n)), maxiter=100 * n)
    fiedler = vectors[:, np.argsort(values)[0]]
    rank = np.argsort(np.argsort(np.round(fiedler, 9), kind="stable"), kind="stable")
    low, high = np.sort(rank[pairs], axis=1).T
    # Edges across the cut before rank k: those that begin below it and end at it or above.
    across = np.cumsum(np.bincount(low + 1, minlength=n + 1) - np.bincount(high + 1, minlength=n + 1))
    sizes = np.arange(1, n)
    cost = across[1:n] / (np.minimum(sizes, n - sizes) / n)
    cost[np.minimum(sizes, n - sizes) < _EVEN * n] = np.inf
    cut = int(sizes[np.argmin(cost)])
    return {id for id, place in zip(ids, rank, strict=True) if place < cut}


def _merge_small_parts(pieces: list[list[str]], most: int) -> list[list[str]]:
    """Merges pieces of at most ten viewpoints into other pieces that have room, so that they are not separate scans."""
    bins: list[list[str]] = []
    for piece in sorted(pieces, key=lambda ids: (-len(ids), ids[0])):
        room = next((b for b in bins if len(piece) <= LEAST and len(b) + len(piece) <= most), None)
        if room is None:
            bins.append(list(piece))
        else:
            room += piece
    return bins


def _part(graph: NavGraph, name: str, ids: list[str]) -> NavGraph:
    chosen = set(ids)
    viewpoints = {id: v for id, v in graph.viewpoints.items() if id in chosen}
    edges = {key: edge for key, edge in graph.edges.items() if chosen.issuperset(key)}
    return replace(graph, scan=name, viewpoints=viewpoints, edges=edges, evidence={})


def _letters(number: int) -> str:
    """Returns a to z, then aa, ab and so on."""
    letters = ""
    number += 1
    while number:
        number, digit = divmod(number - 1, 26)
        letters = chr(ord("a") + digit) + letters
    return letters
