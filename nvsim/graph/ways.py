"""Shortest ways along a graph, in metres: how long they are, and which of them are not the only ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph

SAME_LENGTH = 0.01
"""Metres: ways that differ by no more are tied."""


@dataclass(frozen=True, eq=False)
class Ways:
    """The included viewpoints and the edges between them.

    ids     (N) in file order
    places  (N, 3) metres
    floor   (N,) metres, height of the floor under them
    ends    (E, 2) rows of the ends of every edge
    length  (E,) metres, straight from end to end
    """

    ids: tuple[str, ...]
    places: NDArray[np.float64]
    floor: NDArray[np.float64]
    ends: NDArray[np.int64]
    length: NDArray[np.float64]

    @classmethod
    def of(cls, graph: NavGraph) -> Ways:
        ids = tuple(id for id, v in graph.viewpoints.items() if v.included)
        row = {id: i for i, id in enumerate(ids)}
        places = np.array([graph.viewpoints[id].position for id in ids], np.float64).reshape(-1, 3)
        heights = np.array([graph.viewpoints[id].height for id in ids], np.float64)
        kept = [(row[a], row[b]) for a, b in graph.edges if a in row and b in row]
        ends = np.array(kept, np.int64).reshape(-1, 2)
        length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
        return cls(ids, places, places[:, 2] - heights, ends, length)

    def lengths(self, sources: NDArray[np.integer], limit: float = np.inf) -> NDArray[np.float64]:
        """(S, N) metres of the shortest ways from the rows `sources` (S,); infinite where there is none, or none under
        `limit` metres."""
        return np.asarray(self._dijkstra(sources, limit)[0])

    def tied(self, source: int) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
        """Of the shortest ways from row `source` to every viewpoint: (N,) metres (infinite where there is none), (N,)
        number of edges, and (N,) whether a second way is at most SAME_LENGTH longer.

        The second shortest way leaves the tree of the shortest ones at some edge (Eppstein 1998, Finding the k Shortest
        Paths): its extra length is the least detour over an edge beside the tree into any viewpoint along the way."""
        lengths, parents = self._dijkstra(np.array([source]), np.inf)
        far, parent = lengths[0], parents[0].astype(np.int64)
        starts, stops = np.concatenate([self.ends, self.ends[:, ::-1]]).T
        # An edge walked there and back at once is no way of its own.
        beside = np.isfinite(far[starts]) & (parent[stops] != starts) & (parent[starts] != stops) & (stops != source)
        starts, stops = starts[beside], stops[beside]
        extra = np.full(len(far), np.inf)
        np.minimum.at(extra, stops, far[starts] + np.tile(self.length, 2)[beside] - far[stops])
        edges = (parent >= 0).astype(np.int64)
        parent = np.where(parent >= 0, parent, np.arange(len(far)))
        while (parent[parent] != parent).any():  # every round doubles how far back is looked
            extra, edges = np.minimum(extra, extra[parent]), edges + edges[parent]
            parent = parent[parent]
        return far, edges, extra <= SAME_LENGTH

    def _dijkstra(self, sources: NDArray[np.integer], limit: float) -> tuple[Any, Any]:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import dijkstra

        count = len(self.ids)
        matrix = coo_matrix((self.length, (self.ends[:, 0], self.ends[:, 1])), shape=(count, count)).tocsr()
        return dijkstra(matrix, directed=False, indices=sources, return_predecessors=True, limit=limit)
