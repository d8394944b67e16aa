"""Scans as arrays for agents in training, read from graphs and features files: candidates, angles and features.

A step of a batch is a lookup. The arrays are a closed form of the simulator's states; no images are rendered.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.directions import VIEWS
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.features.candidates import candidates_of
from nvsim.r2r.features.feature_files import Key, features_of
from nvsim.r2r.tasks.shortest import ShortestPaths

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
STOP = 0
"""The slot of stopping; candidates are in the slots from 1 on."""


@dataclass(frozen=True, eq=False)
class ScanPaths:
    """A scan in the world: the row of its `first` viewpoint, and its shortest paths by rows of its own."""

    first: int
    shortest: ShortestPaths


@dataclass(frozen=True, eq=False)
class PathsToGoal:
    """The shortest paths to a goal, in the scan whose first row is `first`.

    next     (n,) row of the next viewpoint on the shortest path; -1 at the goal and if there is no path
    meters   (n,) float64, meters to the goal along the graph
    """

    first: int
    next: Int64
    meters: NDArray[np.float64]


@dataclass(eq=False)
class World:
    """The N viewpoints of all scans in one array, with up to K candidates each.

    keys       (N) scan and viewpoint id
    row        scan and viewpoint id -> row
    target     (N, K) rows; -1 for slots without a candidate
    heading    (N, K) float32 radians, world: 0 is +y, positive turns right
    elevation  (N, K) float32 radians above the horizon
    distance   (N, K) float32 meters
    seen       (N, K) rows of `features`: the view that shows the candidate best
    features   (M, F) float32, each row with mean 0 and standard deviation 1; row 0 is zeros
    panorama   (N, 36) rows of `features`; None without panoramas
    scans      by scan id
    """

    keys: list[Key]
    row: Mapping[Key, int]
    target: Int64
    heading: Float32
    elevation: Float32
    distance: Float32
    seen: Int64
    features: Float32
    panorama: Int64 | None
    scans: Mapping[str, ScanPaths]
    _onward: dict[int, PathsToGoal] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """Numbers per view."""
        return self.features.shape[1]

    def paths_to(self, goal: int) -> PathsToGoal:
        """Returns the shortest paths to the row `goal`, with ties as in nvsim.r2r.tasks.shortest."""
        if goal not in self._onward:
            scan = self.scans[self.keys[goal][0]]
            tree = scan.shortest.tree(goal - scan.first)
            after = np.where(tree.before >= 0, tree.before + scan.first, -1)
            self._onward[goal] = PathsToGoal(scan.first, after, tree.meters)
        return self._onward[goal]

    def shortest_path_slots(self, here: Int64, goals: Int64) -> Int64:
        """Returns (B,) int64 the slot on the shortest path from rows `here` (B,) to rows `goals` (B,).

        It is STOP at the goal, and -1 if no candidate is on the path.
        """
        found = np.full(len(here), -1, np.int64)
        for i, (at, goal) in enumerate(zip(here.tolist(), goals.tolist())):
            if at == goal:
                found[i] = STOP
                continue
            onward = self.paths_to(goal)
            slots = np.flatnonzero(self.target[at] == onward.next[at - onward.first])
            if onward.next[at - onward.first] >= 0 and len(slots):
                found[i] = 1 + slots[0]
        return found

    def rows_after(self, here: Int64, slots: Int64) -> Int64:
        """Returns (B,) the rows after taking `slots` (B,) from rows `here` (B,)."""
        return np.where(slots == STOP, here, self.target[here, slots - 1])

    def meters(self, here: Int64, goals: Int64) -> NDArray[np.float64]:
        """Returns (B,) meters from rows `here` (B,) to rows `goals` (B,) along the graph."""
        each = zip(here.tolist(), goals.tolist())
        return np.array([(o := self.paths_to(goal)).meters[at - o.first] for at, goal in each])


@dataclass(frozen=True, eq=False)
class ExportFiles:
    """The files of one export.

    graphs     by scan id
    features   the file with their features
    """

    graphs: Mapping[str, NavGraph]
    features: Path


class _CandidateSlots(NamedTuple):
    """The n viewpoints of a scan with up to k candidates each. `target` and `view` are -1 in unused slots."""

    target: Int64  # (n, k) rows of the world
    heading: NDArray[np.float64]
    elevation: NDArray[np.float64]
    distance: NDArray[np.float64]
    view: Int64


def read_world(sources: Sequence[ExportFiles], panorama: bool, closed: Collection[Key] = ()) -> World:
    """Reads the world of all scans of all sources.

    panorama   whether all 36 views of the viewpoints are kept
    closed     viewpoints that agents must not enter; they are never candidates

    Raises InputError if a scan occurs twice, features are missing, or features files have different widths.
    """
    keys: list[Key] = []
    scans: dict[str, ScanPaths] = {}
    slots: list[_CandidateSlots] = []
    for source in sources:
        for scan, graph in source.graphs.items():
            if scan in scans:
                raise InputError(f"The scan {scan} is in two of the folders; remove one of the folders.")
            ways = PathGraph.of(graph)
            scans[scan] = ScanPaths(len(keys), ShortestPaths(ways))
            slots.append(_slots(scan, ways, len(keys), closed))
            keys += [(scan, id) for id in ways.ids]
    if not keys:
        raise InputError("The scans have no included viewpoints, so an agent cannot move; export other scans.")
    joined = _CandidateSlots(
        *(_stack_tables(arrays, -1 if name in ("target", "view") else 0) for name, arrays in _fields(slots))
    )
    row = {key: i for i, key in enumerate(keys)}
    features, seen, first = _read_features(sources, row, joined.view, panorama)
    angles = (joined.heading, joined.elevation, joined.distance)
    whole = first[:, None] + np.arange(VIEWS) if panorama else None
    heading, elevation, distance = (values.astype(np.float32) for values in angles)
    return World(keys, row, joined.target, heading, elevation, distance, seen, features, whole, scans)


def _slots(scan: str, ways: PathGraph, first: int, closed: Collection[Key]) -> _CandidateSlots:
    edges = np.concatenate([ways.ends, ways.ends[:, ::-1]])
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    entered = np.array([(scan, id) not in closed for id in ways.ids], bool)
    found = candidates_of(ways.places, edges[entered[edges[:, 1]]])
    count = len(ways.ids)
    # The candidates of a viewpoint are consecutive.
    place = np.arange(len(found.source)) - np.searchsorted(found.source, found.source)
    most = int(place.max(initial=-1)) + 1

    def fill(values: NDArray[Any], empty: float) -> NDArray[Any]:
        table = np.full((count, most), empty, values.dtype)
        table[found.source, place] = values
        return table

    heading, elevation, distance = (fill(v, 0) for v in (found.heading, found.elevation, found.distance))
    return _CandidateSlots(fill(found.target + first, -1), heading, elevation, distance, fill(found.view, -1))


def _fields(slots: Sequence[_CandidateSlots]) -> Sequence[tuple[str, list[NDArray[Any]]]]:
    return [(name, [getattr(of, name) for of in slots]) for name in _CandidateSlots._fields]


def _stack_tables(tables: Sequence[NDArray[Any]], empty: float) -> NDArray[Any]:
    """Stacks tables vertically, each padded to the widest."""
    most = max(table.shape[1] for table in tables)
    return np.concatenate([np.pad(t, ((0, 0), (0, most - t.shape[1])), constant_values=empty) for t in tables])


def _read_features(
    sources: Sequence[ExportFiles], row: Mapping[Key, int], view: Int64, panorama: bool
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
            kept.append(_normalize_rows(views[chosen]))
            held += len(chosen)
    return np.concatenate([np.zeros_like(kept[0][:1], shape=(1, kept[0].shape[1])), *kept]), seen, first


def _normalize_rows(rows: Float32) -> Float32:
    """Scales rows to mean 0 and standard deviation 1, so that features of any network have one scale."""
    centered = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(centered / (centered.std(axis=1, keepdims=True) + 1e-6), np.float32)
