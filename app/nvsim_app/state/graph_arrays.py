"""Graph and trajectory as flat arrays for views that draw thousands of objects. An edit changes only a few rows,
and is recorded for the views."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.trajectories import trajectories
from nvsim.capture.types import Capture
from nvsim.graph.difference import Difference
from nvsim.graph.types import NavGraph
from nvsim.reconstruction.growing_trajectory import GrowingTrajectory
from nvsim.submaps.split import Submap

STEPS = 16  # number of recorded edits
MOST = 2000  # maximum number of viewpoints and edges of an edit; after a larger edit, everything is repainted
_MISSING = 3  # maximum distance in frames between two frames of a video that a line connects


@dataclass(frozen=True, eq=False)
class GraphArrays:
    """A graph as arrays.

    ids        viewpoint ids in file order; viewpoints that an edit added are at the end
    positions  (N, 3) float64 meters, world, of the camera
    feet       (N, 3) float64 meters, world, of the floor below the camera. Views draw the graph there, because all
               cameras are at the height of the horizon
    edges      (M, 2) int64 indices into ids
    submaps    (N,) int64 submap index, -1 for none
    included   (N,) bool
    index      id -> row

    Updates return new values and do not modify shared arrays.
    """

    ids: tuple[str, ...] = ()
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    feet: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    edges: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    submaps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    included: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    index: dict[str, int] = field(default_factory=dict)

    @staticmethod
    def of(graph: NavGraph | None) -> GraphArrays:
        if graph is None:
            return GraphArrays()
        ids = tuple(graph.viewpoints)
        index = dict(zip(ids, range(len(ids)), strict=True))
        values = graph.viewpoints.values()
        positions = np.array([v.position for v in values], np.float64).reshape(-1, 3)
        feet = positions.copy()
        feet[:, 2] -= [v.height for v in values]
        ends = map(index.__getitem__, chain.from_iterable(graph.edges))
        return GraphArrays(
            ids,
            positions,
            feet,
            np.fromiter(ends, np.int64, 2 * len(graph.edges)).reshape(-1, 2),
            np.array([v.submap for v in values], np.int64),
            np.array([v.included for v in values], bool),
            index,
        )

    def updated(self, graph: NavGraph, change: Difference) -> GraphArrays:
        """The arrays of `graph`, which differs by `change` from the graph of these arrays."""
        small = len(self.ids) // 4 + 16
        if len(change.added_viewpoints) + len(change.removed_viewpoints) + len(change.changed_viewpoints) > small:
            return GraphArrays.of(graph)
        edges = self._without_edges(self.edges, change.removed_edges)
        arrays = self
        if change.removed_viewpoints:
            arrays, edges = self._without_viewpoints(change.removed_viewpoints, edges)
        if change.added_viewpoints:
            added = GraphArrays.of(NavGraph("", {id: graph.viewpoints[id] for id in change.added_viewpoints}))
            count = len(arrays.ids)
            arrays = GraphArrays(
                arrays.ids + added.ids,
                np.concatenate([arrays.positions, added.positions]),
                np.concatenate([arrays.feet, added.feet]),
                edges,
                np.concatenate([arrays.submaps, added.submaps]),
                np.concatenate([arrays.included, added.included]),
                arrays.index | {id: count + i for i, id in enumerate(added.ids)},
            )
        if change.added_edges:
            rows = [(arrays.index[a], arrays.index[b]) for a, b in change.added_edges]
            edges = np.concatenate([edges, np.array(rows, np.int64)])
        if change.changed_viewpoints:
            arrays = arrays._changed(graph, change.changed_viewpoints)
        return replace(arrays, edges=edges)

    def edge_rows(self, keys: Iterable[tuple[str, str]]) -> NDArray[np.int64]:
        """(K,) int64 rows of `edges` whose keys are in `keys`."""
        known = [(self.index[a], self.index[b]) for a, b in keys if a in self.index and b in self.index]
        if not known or not len(self.edges):
            return np.zeros(0, np.int64)
        if len(known) == 1:
            a, b = known[0]
            return np.flatnonzero((self.edges[:, 0] == a) & (self.edges[:, 1] == b))
        wanted = np.array(known, np.int64)
        count = len(self.ids)
        return np.flatnonzero(np.isin(self.edges @ [count, 1], wanted @ [count, 1]))

    def edge_key(self, row: int) -> tuple[str, str]:
        """The key of the edge in `row`."""
        a, b = self.edges[row]
        return self.ids[a], self.ids[b]

    def viewpoint_rows(self, ids: Iterable[str]) -> NDArray[np.int64]:
        """(K,) int64 rows of the viewpoints in `ids` that exist."""
        return np.array([self.index[id] for id in ids if id in self.index], np.int64)

    def _without_edges(self, edges: NDArray[np.int64], keys: tuple[tuple[str, str], ...]) -> NDArray[np.int64]:
        return np.delete(edges, self.edge_rows(keys), axis=0) if keys else edges

    def _without_viewpoints(
        self, gone: tuple[str, ...], edges: NDArray[np.int64]
    ) -> tuple[GraphArrays, NDArray[np.int64]]:
        keep = np.ones(len(self.ids), bool)
        keep[self.viewpoint_rows(gone)] = False
        moved_to = np.cumsum(keep) - 1
        # Copy runs of remaining ids, so that the removal of one viewpoint does not visit each id.
        ends = [-1, *np.flatnonzero(~keep).tolist(), len(self.ids)]
        ids = tuple(chain.from_iterable(self.ids[a + 1 : b] for a, b in pairwise(ends)))
        arrays = GraphArrays(
            ids,
            self.positions[keep],
            self.feet[keep],
            edges,
            self.submaps[keep],
            self.included[keep],
            dict(zip(ids, range(len(ids)), strict=True)),
        )
        return arrays, moved_to[edges]

    def _changed(self, graph: NavGraph, ids: tuple[str, ...]) -> GraphArrays:
        rows = [self.index[id] for id in ids]
        fresh = GraphArrays.of(NavGraph("", {id: graph.viewpoints[id] for id in ids}))
        positions, feet = self.positions.copy(), self.feet.copy()
        submaps, included = self.submaps.copy(), self.included.copy()
        positions[rows], feet[rows], submaps[rows], included[rows] = (
            fresh.positions,
            fresh.feet,
            fresh.submaps,
            fresh.included,
        )
        return replace(self, positions=positions, feet=feet, submaps=submaps, included=included)


@dataclass(frozen=True, eq=False)
class TrajectoryArrays:
    """A trajectory as arrays.

    positions   (N, 3) float64 meters, world, in frame order
    submaps     (N,) int64 submap whose core contains the frame, else -1
    segments    (M, 2) int64 indices of consecutive frames of one trajectory without a jump
    """

    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    submaps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    segments: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))

    @staticmethod
    def of(capture: Capture | None, submaps: tuple[Submap, ...]) -> TrajectoryArrays:
        if capture is None or not capture.frames:
            return TrajectoryArrays()
        owner = np.full(len(capture.frames), -1, np.int64)
        for submap in submaps:
            core = np.array(submap.core)
            owner[core[core < len(owner)]] = submap.index  # of a capture that was read before these submaps
        positions = capture.positions
        segments = []
        for frames in trajectories(capture):
            gaps = np.linalg.norm(np.diff(positions[frames], axis=0), axis=1)
            # A step much longer than the median is a jump between trajectories.
            usual = float(np.median(gaps)) if len(gaps) else 0.0
            segments.append(np.stack([frames[:-1], frames[1:]], axis=1)[gaps <= max(2.0, 8 * usual)])
        return TrajectoryArrays(positions, owner, np.concatenate(segments))

    @staticmethod
    def from_growing(found: GrowingTrajectory) -> TrajectoryArrays:
        """The cameras of a video whose poses are being computed. A piece of the video is treated like a submap."""
        rows = np.arange(len(found.positions))
        near = (np.diff(found.piece) == 0) & (np.diff(found.frame) <= _MISSING)
        return TrajectoryArrays(found.positions, found.piece, np.stack([rows[:-1], rows[1:]], axis=1)[near])


def column_bounds(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The minimum and the maximum (D,) of each column of `points` (N, D), N > 0. The loop over columns is a hundred
    times as fast as numpy's reduction of short rows."""
    columns = points.T
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])


class GraphChanges:
    """The changes of the document's graph arrays between a drawn version and the latest one, so that views repaint only
    the changed parts."""

    def __init__(self) -> None:
        self._steps: deque[tuple[ReferenceType[GraphArrays], NDArray[np.float64] | None]] = deque(maxlen=STEPS)

    def clear(self) -> None:
        """Discards all changes, because another graph was opened."""
        self._steps.clear()

    def note(self, before: GraphArrays, after: GraphArrays, change: Difference) -> None:
        """Records an edit that changed the latest arrays `before` to `after`."""
        ids = (*change.added_viewpoints, *change.removed_viewpoints, *change.changed_viewpoints)
        keys = (*change.added_edges, *change.removed_edges, *change.changed_edges)
        places = None
        if len(ids) + len(keys) <= MOST:
            places = np.concatenate([_places(before, ids, keys), _places(after, ids, keys)])
        self._steps.append((ref(before), places))

    def changed_segments_since(self, drawn: object) -> NDArray[np.float64] | None:
        """(K, 2, 3) meters, world: the floor segments of added, removed, and moved edges since the arrays `drawn`.
        Viewpoints are segments of length 0. None if the changes are not known."""
        found: list[NDArray[np.float64]] = []
        for before, places in reversed(self._steps):
            if places is None:
                return None
            found.append(places)
            if before() is drawn:
                return np.concatenate(found)
        return None


def _places(
    arrays: GraphArrays, ids: Iterable[str], keys: Iterable[tuple[str, str]]
) -> NDArray[np.float64]:  # fmt: skip
    rows = arrays.viewpoint_rows(ids)
    touched = np.zeros(len(arrays.ids), bool)
    touched[rows] = True
    edges = arrays.edges
    among = edges[touched[edges[:, 0]] | touched[edges[:, 1]]] if len(rows) else edges[:0]
    named = edges[arrays.edge_rows(keys)]
    pairs = np.concatenate([np.stack([rows, rows], axis=1), among, named])
    return arrays.feet[pairs]
