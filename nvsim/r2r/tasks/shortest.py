"""Shortest paths with a deterministic choice between paths of equal length, and those that may become tasks.

Lengths are rounded to micrometers, so that sums are exact on every machine. Among paths of equal length, the one with
the fewest edges is selected. Further ties are resolved from the end of the path: the viewpoint that comes first in the
file is selected.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import EdgeKey

_TO_MICROMETERS = 1e6
LONGEST = 100
"""Largest number of edges in a path."""


@dataclass(frozen=True, eq=False)
class ShortestPathTree:
    """The shortest paths from one viewpoint, by rows of Ways.

    meters   (N,) float64, meters, infinite if there is no path
    edges    (N,) int64, -1 if there is no path within the requested number of edges
    before   (N,) int64, the second-last viewpoint of the path, -1 at the source and where `edges` is -1
    """

    meters: NDArray[np.float64]
    edges: NDArray[np.int64]
    before: NDArray[np.int64]

    def back_from(self, row: int) -> list[int]:
        """Returns the rows from `row` back to the source. Edges are undirected, so this is also a shortest path."""
        rows = [row]
        while self.before[rows[-1]] >= 0:
            rows.append(int(self.before[rows[-1]]))
        return rows


class ShortestPaths:
    """Computes shortest paths between the included viewpoints of a graph."""

    def __init__(self, ways: PathGraph) -> None:
        from scipy.sparse import coo_matrix

        count = len(ways.ids)
        length = np.maximum(np.rint(ways.length * _TO_MICROMETERS), 1.0)  # in a sparse matrix, 0 means no edge
        self._starts, self._stops = np.concatenate([ways.ends, ways.ends[:, ::-1]]).T
        self._length = np.tile(length, 2)
        self._matrix = coo_matrix((length, (ways.ends[:, 0], ways.ends[:, 1])), shape=(count, count)).tocsr()

    def tree(self, source: int, most: int | None = None) -> ShortestPathTree:
        """Returns the shortest paths from row `source` that have up to `most` edges."""
        from scipy.sparse.csgraph import dijkstra

        far = np.asarray(dijkstra(self._matrix, directed=False, indices=source))
        count = len(far)
        with np.errstate(invalid="ignore"):
            tight = np.isfinite(far[self._starts]) & (far[self._starts] + self._length == far[self._stops])
        starts, stops = self._starts[tight], self._stops[tight]
        edges = np.full(count, count, np.int64)
        edges[source] = 0
        for _ in range(count if most is None else most):
            known = edges.copy()
            np.minimum.at(edges, stops, known[starts] + 1)
            if (edges == known).all():
                break
        last = (edges[stops] < count) & (edges[starts] + 1 == edges[stops])
        before = np.full(count, count, np.int64)
        np.minimum.at(before, stops[last], starts[last])
        unreached = edges >= count
        edges[unreached] = before[unreached] = -1
        before[source] = -1
        return ShortestPathTree(far / _TO_MICROMETERS, edges, before)


@dataclass(frozen=True)
class PathBounds:
    """Limits of paths; the defaults are those of R2R (Anderson et al. 2018, section 4.1)."""

    fewest_edges: int = 4
    """Smallest number of edges in a path."""
    most_edges: int = 6
    """Largest number of edges in a path."""
    least_meters: float = 5.0
    """Smallest length of a path in meters."""
    most_meters: float = math.inf
    """Largest length of a path in meters."""
    ties: bool = False
    """Also use paths that have an alternative at most 1 cm longer. Agents may be taught the alternative."""

    def __post_init__(self) -> None:
        if not 1 <= self.fewest_edges <= self.most_edges <= LONGEST:
            raise InputError(
                f"No path has from {self.fewest_edges} to {self.most_edges} edges; give --fewest-edges from 1 to "
                f"--most-edges, and --most-edges up to {LONGEST}."
            )
        if not 0 <= self.least_meters <= self.most_meters:
            raise InputError(
                f"No path is from {self.least_meters:g} to {self.most_meters:g} m long; give --least-meters from 0 to "
                "--most-meters."
            )


@dataclass(frozen=True, eq=False)
class EligiblePaths:
    """The paths of a graph that may become tasks, each in one direction.

    ids      (N) viewpoint ids
    rows     (M, most_edges + 1) int64, the viewpoints of each path, -1 after its end
    meters   (M,) float64, meters
    """

    ids: tuple[str, ...]
    rows: NDArray[np.int64]
    meters: NDArray[np.float64]

    def path(self, i: int) -> tuple[int, ...]:
        return tuple(self.rows[i][self.rows[i] >= 0].tolist())

    def inside(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns (M,) bool: whether all viewpoints of each path are in `chosen` (N,) bool."""
        return np.asarray(np.append(chosen, True)[self.rows].all(axis=1))

    def excluding(self, edges: Collection[EdgeKey], ends: Collection[str]) -> EligiblePaths:
        """Returns the paths that use none of `edges`, and neither begin nor end at a viewpoint of `ends`."""
        row, count = {id: i for i, id in enumerate(self.ids)}, len(self.ids)
        refused = [min(row[a], row[b]) * count + max(row[a], row[b]) for a, b in edges if a in row and b in row]
        a, b = self.rows[:, :-1], self.rows[:, 1:]
        uses = np.isin(np.minimum(a, b) * count + np.maximum(a, b), refused) & (b >= 0)
        goals = self.rows[np.arange(len(self.rows)), (self.rows >= 0).sum(axis=1) - 1]
        no_end = [row[id] for id in ends if id in row]
        kept = ~(uses.any(axis=1) | np.isin(self.rows[:, 0], no_end) | np.isin(goals, no_end))
        return replace(self, rows=self.rows[kept], meters=self.meters[kept])


def eligible_paths(ways: PathGraph, bounds: PathBounds) -> EligiblePaths:
    """Returns the shortest path between every two viewpoints, if it is within the bounds."""
    shortest = ShortestPaths(ways)
    most = bounds.most_edges
    found, lengths = [np.zeros((0, most + 1), np.int64)], [np.zeros(0)]
    for source in range(len(ways.ids)):
        tree = shortest.tree(source, most)
        fits = (tree.edges >= bounds.fewest_edges) & (tree.edges <= most)
        fits &= (tree.meters >= bounds.least_meters) & (tree.meters <= bounds.most_meters)
        fits[: source + 1] = False  # these pairs were tested from their other end
        if not bounds.ties and fits.any():
            fits &= ~ways.shortest_paths_with_ties(source)[2]
        ends = np.flatnonzero(fits)
        rows = np.full((len(ends), most + 1), -1, np.int64)
        here = ends
        for k in range(most + 1):
            rows[:, k] = here
            here = np.where(here >= 0, tree.before[here], -1)
        found.append(rows)
        lengths.append(tree.meters[ends])
    return EligiblePaths(ways.ids, np.concatenate(found), np.concatenate(lengths))
