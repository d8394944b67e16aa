"""Shortest paths with a deterministic choice between paths of equal length.

Lengths are rounded to micrometers, so that sums are exact on every machine. Among paths of equal length, the one with
the fewest edges is selected. Further ties are resolved from the end of the path: the viewpoint that comes first in the
file is selected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.ways import Ways

_TO_MICROMETRES = 1e6


@dataclass(frozen=True, eq=False)
class Tree:
    """The shortest paths from one viewpoint, by rows of Ways.

    metres   (N,) float64, meters, infinite if there is no path
    edges    (N,) int64, -1 if there is no path within the requested number of edges
    before   (N,) int64, the second-last viewpoint of the path, -1 at the source and where `edges` is -1
    """

    metres: NDArray[np.float64]
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

    def __init__(self, ways: Ways) -> None:
        from scipy.sparse import coo_matrix

        count = len(ways.ids)
        length = np.maximum(np.rint(ways.length * _TO_MICROMETRES), 1.0)  # in a sparse matrix, 0 means no edge
        self._starts, self._stops = np.concatenate([ways.ends, ways.ends[:, ::-1]]).T
        self._length = np.tile(length, 2)
        self._matrix = coo_matrix((length, (ways.ends[:, 0], ways.ends[:, 1])), shape=(count, count)).tocsr()

    def tree(self, source: int, most: int | None = None) -> Tree:
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
        return Tree(far / _TO_MICROMETRES, edges, before)
