"""Reads the world of exported scans from their graphs and features files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.view_sweep import VIEWS
from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.r2r.features.candidates import candidates_of
from nvsim.r2r.features.feature_reading import Key, features_of
from nvsim.r2r.recurrent.world import Float32, Int64, Within, World
from nvsim.r2r.tasks.shortest import ShortestPaths


@dataclass(frozen=True, eq=False)
class Source:
    """The files of one export.

    graphs     by scan id
    features   the file with their features
    """

    graphs: Mapping[str, NavGraph]
    features: Path


class _Slots(NamedTuple):
    """The n viewpoints of a scan with up to k candidates each. `target` and `view` are -1 in unused slots."""

    target: Int64  # (n, k) rows of the world
    heading: NDArray[np.float64]
    elevation: NDArray[np.float64]
    distance: NDArray[np.float64]
    view: Int64


def read_world(sources: Sequence[Source], panorama: bool, closed: Collection[Key] = ()) -> World:
    """Reads the world of all scans of all sources.

    panorama   whether all 36 views of the viewpoints are kept
    closed     viewpoints that agents must not enter; they are never candidates

    Raises InputError if a scan occurs twice, features are missing, or features files have different widths.
    """
    keys: list[Key] = []
    scans: dict[str, Within] = {}
    slots: list[_Slots] = []
    for source in sources:
        for scan, graph in source.graphs.items():
            if scan in scans:
                raise InputError(f"The scan {scan} is in two of the folders; remove one of the folders.")
            ways = Ways.of(graph)
            scans[scan] = Within(len(keys), ShortestPaths(ways))
            slots.append(_slots(scan, ways, len(keys), closed))
            keys += [(scan, id) for id in ways.ids]
    if not keys:
        raise InputError("The scans have no included viewpoints, so an agent cannot move; export other scans.")
    joined = _Slots(*(_stacked(arrays, -1 if name in ("target", "view") else 0) for name, arrays in _fields(slots)))
    row = {key: i for i, key in enumerate(keys)}
    features, seen, first = _read_features(sources, row, joined.view, panorama)
    angles = (joined.heading, joined.elevation, joined.distance)
    whole = first[:, None] + np.arange(VIEWS) if panorama else None
    heading, elevation, distance = (values.astype(np.float32) for values in angles)
    return World(keys, row, joined.target, heading, elevation, distance, seen, features, whole, scans)


def _slots(scan: str, ways: Ways, first: int, closed: Collection[Key]) -> _Slots:
    edges = np.concatenate([ways.ends, ways.ends[:, ::-1]])
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    entered = np.array([(scan, id) not in closed for id in ways.ids], bool)
    found = candidates_of(ways.places, edges[entered[edges[:, 1]]])
    count = len(ways.ids)
    # The candidates of a viewpoint are consecutive.
    place = np.arange(len(found.source)) - np.searchsorted(found.source, found.source)
    most = int(place.max(initial=-1)) + 1

    def filled(values: NDArray[Any], empty: float) -> NDArray[Any]:
        table = np.full((count, most), empty, values.dtype)
        table[found.source, place] = values
        return table

    heading, elevation, distance = (filled(v, 0) for v in (found.heading, found.elevation, found.distance))
    return _Slots(filled(found.target + first, -1), heading, elevation, distance, filled(found.view, -1))


def _fields(slots: Sequence[_Slots]) -> Sequence[tuple[str, list[NDArray[Any]]]]:
    return [(name, [getattr(of, name) for of in slots]) for name in _Slots._fields]


def _stacked(tables: Sequence[NDArray[Any]], empty: float) -> NDArray[Any]:
    """Stacks tables vertically, each padded to the widest."""
    most = max(table.shape[1] for table in tables)
    return np.concatenate([np.pad(t, ((0, 0), (0, most - t.shape[1])), constant_values=empty) for t in tables])


def _read_features(
    sources: Sequence[Source], row: Mapping[Key, int], view: Int64, panorama: bool
) -> tuple[Float32, Int64, Int64]:
    """Reads the features that are needed.

    Returns the rows, of which row 0 is zeros; (N, K) the row that shows each candidate; (N,) the first row of each
    viewpoint. With panoramas, all views of a viewpoint are kept, else only those that show a candidate.
    """
    kept: list[Float32] = []
    seen, first = np.zeros_like(view), np.zeros(len(row), np.int64)
    held = 1
    for source in sources:
        mine = [key for key in row if key[0] in source.graphs]
        for key, views in features_of(source.features, mine):
            if kept and kept[0].shape[1] != views.shape[1]:
                raise InputError(
                    f"{source.features} has {views.shape[1]} numbers per view, but another file has "
                    f"{kept[0].shape[1]}; give features of one layout."
                )
            at = row[key]
            there = view[at] >= 0
            chosen = np.arange(VIEWS) if panorama else np.unique(view[at][there])
            seen[at, there] = held + np.searchsorted(chosen, view[at][there])
            first[at] = held
            kept.append(_normed(views[chosen]))
            held += len(chosen)
    return np.concatenate([np.zeros_like(kept[0][:1], shape=(1, kept[0].shape[1])), *kept]), seen, first


def _normed(rows: Float32) -> Float32:
    """Scales rows to mean 0 and standard deviation 1, so that features of any network have one scale."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(centred / (centred.std(axis=1, keepdims=True) + 1e-6), np.float32)
