"""A selection as a value, and functions that select parts of a graph."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits.change import EditError, key_of
from nvsim.graph.types import EdgeKey, NavGraph


@dataclass(frozen=True)
class GraphSelection:
    """Selected viewpoints (ids) and edges (keys)."""

    viewpoints: frozenset[str] = field(default_factory=frozenset)
    edges: frozenset[EdgeKey] = field(default_factory=frozenset)

    def __bool__(self) -> bool:
        return bool(self.viewpoints or self.edges)

    def __or__(self, other: GraphSelection) -> GraphSelection:
        return GraphSelection(self.viewpoints | other.viewpoints, self.edges | other.edges)

    def __and__(self, other: GraphSelection) -> GraphSelection:
        return GraphSelection(self.viewpoints & other.viewpoints, self.edges & other.edges)

    def __sub__(self, other: GraphSelection) -> GraphSelection:
        return GraphSelection(self.viewpoints - other.viewpoints, self.edges - other.edges)

    def __xor__(self, other: GraphSelection) -> GraphSelection:
        """The elements in exactly one of the two selections; toggles."""
        return GraphSelection(self.viewpoints ^ other.viewpoints, self.edges ^ other.edges)


NOTHING = GraphSelection()


def selection(viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = ()) -> GraphSelection:
    """Return a selection of viewpoints and edges. The two ids of an edge may be in either order."""
    return GraphSelection(frozenset(viewpoints), frozenset(key_of(*pair) for pair in edges))


def select_everything(graph: NavGraph) -> GraphSelection:
    """Return all viewpoints and all edges."""
    return GraphSelection(frozenset(graph.viewpoints), frozenset(graph.edges))


def inverted(graph: NavGraph, chosen: GraphSelection) -> GraphSelection:
    """Return the elements that are not selected, of the kinds that are. A selection without edges gives only
    viewpoints, one without viewpoints only edges, and an empty one everything."""
    if not chosen:
        return select_everything(graph)
    viewpoints = frozenset(graph.viewpoints) - chosen.viewpoints if chosen.viewpoints else frozenset()
    edges = frozenset(graph.edges) - chosen.edges if chosen.edges else frozenset()
    return GraphSelection(viewpoints, edges)


def existing_part(graph: NavGraph, chosen: GraphSelection) -> GraphSelection:
    """Return the part of a selection that the graph contains; the given object if that is all of it."""
    if all(id in graph.viewpoints for id in chosen.viewpoints) and all(key in graph.edges for key in chosen.edges):
        return chosen
    return GraphSelection(
        frozenset(id for id in chosen.viewpoints if id in graph.viewpoints),
        frozenset(key for key in chosen.edges if key in graph.edges),
    )


def with_neighbors(graph: NavGraph, chosen: GraphSelection) -> GraphSelection:
    """Return the selection plus the neighbors of its viewpoints and the ends of its edges. If edges are selected, the
    edges between all of these are added as well."""
    ends = chosen.viewpoints.union(*chosen.edges)
    more = ends.union(*(graph.neighbors(id) for id in chosen.viewpoints))
    return GraphSelection(more, chosen.edges | inner_edges(graph, more) if chosen.edges else chosen.edges)


def inner_edges(graph: NavGraph, viewpoints: Iterable[str]) -> frozenset[EdgeKey]:
    """Return the edges with both ends in `viewpoints`."""
    inside = frozenset(viewpoints)
    return frozenset((id, other) for id in inside for other in graph.neighbors(id) if id < other and other in inside)


def component(graph: NavGraph, viewpoints: Iterable[str]) -> GraphSelection:
    """Return all viewpoints that can be reached from `viewpoints`, included or excluded, and the edges between them."""
    # Uses the adjacency of the graph. networkx would first copy 10,000 viewpoints, which doubles the time.
    seen = {id for id in viewpoints if id in graph.viewpoints}
    front = list(seen)
    while front:
        for other in graph.neighbors(front.pop()):
            if other not in seen:
                seen.add(other)
                front.append(other)
    return GraphSelection(frozenset(seen), inner_edges(graph, seen))


def path_between(graph: NavGraph, a: str, b: str) -> GraphSelection:
    """Return the viewpoints and edges of the shortest path in meters from a to b, over included viewpoints.

    Raises EditError if a viewpoint does not exist or there is no path.
    """
    ids = shortest_path(graph, a, b)
    return selection(ids, zip(ids, ids[1:]))


def shortest_path(graph: NavGraph, a: str, b: str) -> tuple[str, ...]:
    """Return the ids on the shortest path in meters, including a and b; see `path_between`. Raises EditError if a
    viewpoint does not exist or there is no path."""
    import networkx as nx

    for id in (a, b):
        if id not in graph.viewpoints:
            raise EditError(f"There is no viewpoint {id}.")
    places = {id: np.array(v.position) for id, v in graph.viewpoints.items() if v.included or id in (a, b)}
    network = nx.Graph()
    network.add_nodes_from(places)
    network.add_weighted_edges_from(
        (u, v, float(np.linalg.norm(places[u] - places[v]))) for u, v in graph.edges if u in places and v in places
    )
    try:
        return tuple(nx.shortest_path(network, a, b, weight="weight"))
    except nx.NetworkXNoPath as error:
        raise EditError(f"No path leads from {a} to {b}.") from error


def select_within(graph: NavGraph, polygon: Sequence[Sequence[float]] | NDArray[np.floating]) -> GraphSelection:
    """Return the viewpoints inside a polygon (N, 2) of x, y in meters, world, and the edges between them. A box is a
    polygon of four corners."""
    corners = np.asarray(polygon, np.float64).reshape(-1, 2)
    if len(corners) < 3 or not graph.viewpoints:
        return NOTHING
    ids = list(graph.viewpoints)
    places = np.array([v.position for v in graph.viewpoints.values()])
    found = inside_polygon(places[:, :2], corners)
    chosen = frozenset(ids[i] for i in np.flatnonzero(found).tolist())
    return GraphSelection(chosen, inner_edges(graph, chosen))


def inside_polygon(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (N,) bool: whether points (N, 2) are inside the polygon of corners (M, 2), by the even-odd rule."""
    found = np.zeros(len(points), bool)
    x, y = points[:, 0], points[:, 1]
    for (x0, y0), (x1, y1) in zip(corners.tolist(), np.roll(corners, -1, axis=0).tolist()):
        if y0 == y1:
            continue
        crosses = np.flatnonzero((y0 > y) != (y1 > y))
        found[crosses] ^= x[crosses] < (x1 - x0) * ((y[crosses] - y0) / (y1 - y0)) + x0
    return found
