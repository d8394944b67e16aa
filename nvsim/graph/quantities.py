"""Values of every viewpoint or edge, for expressions, histograms and tables.

The evidence of an edge is everything measured along it, from either end. This includes corridors to the other end, and
lattice steps that end at the other viewpoint. Stale evidence is ignored.

Of the edges, only stairs count as climbing, not ramps or door thresholds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.storeys import storey_numbers
from nvsim.graph.edits.change import EditError
from nvsim.graph.paths import components
from nvsim.graph.types import EdgeKey, Evidence, NavGraph
from nvsim.occupancy.types import FREE, OccupancyMap

Kind = Literal["viewpoints", "edges"]
Margin = Callable[[NavGraph, EdgeKey], float]
"""The smallest distance of an edge's evidence to the thresholds. Negative: the evidence contradicts the edge. NaN: no
evidence."""

_SAME = 0.01  # meters: a step that ends this close to a viewpoint leads to it


@dataclass(frozen=True)
class QuantityInputs:
    """Optional inputs of quantities, in addition to the graph.

    occupancy  map for `validity`
    margin     margin of an edge for `evidence`; without it, `evidence` is the clearness of the edge
    clearness  replacement of the function `clearness`, such as a cache
    """

    occupancy: OccupancyMap | None = None
    margin: Margin | None = None
    clearness: Callable[[NavGraph, EdgeKey], float] | None = None


Values = NDArray[Any]
_Quantity = Callable[[NavGraph, QuantityInputs], Values]


def quantity(
    graph: NavGraph, name: str, known: QuantityInputs | None = None, kind: Kind | None = None
) -> tuple[tuple[Any, ...], Values]:
    """Return the ids of viewpoints or the keys of edges in file order, and their (N,) values. Values are floats, with
    NaN if unknown, bools, or strings.

    `kind` is the kind of elements. By default it is the kind that has the quantity, viewpoints first. Raises EditError
    if the quantity does not exist, or if it needs a map and there is none.
    """
    tables = {"viewpoints": VIEWPOINTS, "edges": EDGES}
    wanted = [kind] if kind is not None else ["viewpoints", "edges"]
    for each in wanted:
        found = tables[each].get(name)
        if found is not None:
            names: tuple[Any, ...] = tuple(graph.viewpoints if each == "viewpoints" else graph.edges)
            return names, found(graph, known or QuantityInputs())
    names_known = sorted({n for each in wanted for n in tables[each]})
    raise EditError(f"There is no quantity {name!r}; choose one of {', '.join(names_known)}.")


def evidence_along(graph: NavGraph, key: EdgeKey) -> list[Evidence]:
    """Return the evidence along an edge from both ends, without stale evidence."""
    found = []
    for id, other in (key, key[::-1]):
        x, y, _ = graph.viewpoints[other].position
        for name in graph.evidence_of.get(id, ()):
            e = graph.evidence[name]
            if e.viewpoint != id or e.stale:
                continue
            if e.joins == other or (not e.joins and math.hypot(e.target[0] - x, e.target[1] - y) < _SAME):
                found.append(e)
    return found


def edge_rows(graph: NavGraph) -> NDArray[np.int64]:
    """Return (E, 2) int64, the rows of the two ends of every edge in the viewpoints, in file order."""
    row = dict(zip(graph.viewpoints, range(len(graph.viewpoints)), strict=True))
    ends = map(row.__getitem__, chain.from_iterable(graph.edges))
    return np.fromiter(ends, np.int64, 2 * len(graph.edges)).reshape(-1, 2)


def places_of(graph: NavGraph) -> NDArray[np.float64]:
    """Return the (N, 3) camera positions, meters, world, in file order."""
    return np.array([v.position for v in graph.viewpoints.values()], np.float64).reshape(-1, 3)


def _of_viewpoint(name: str, kind: type) -> _Quantity:
    return lambda graph, known: np.array([getattr(v, name) for v in graph.viewpoints.values()], kind)


def _of_edge(name: str, kind: type) -> _Quantity:
    return lambda graph, known: np.array([getattr(e, name) for e in graph.edges.values()], kind)


def _axis(axis: int) -> _Quantity:
    return lambda graph, known: places_of(graph)[:, axis]


def _middle(axis: int) -> _Quantity:
    return lambda graph, known: places_of(graph)[edge_rows(graph), axis].mean(axis=1)


def _at_start(of_viewpoint: _Quantity) -> _Quantity:
    """The value of an edge's first end."""
    return lambda graph, known: of_viewpoint(graph, known)[edge_rows(graph)[:, 0]]


def _degree(graph: NavGraph, known: QuantityInputs) -> Values:
    return np.array([len(graph.neighbors(id)) for id in graph.viewpoints], np.float64)


def _component(graph: NavGraph, known: QuantityInputs) -> Values:
    """0 for the largest component; -1 for excluded viewpoints."""
    number = {id: i for i, group in enumerate(components(graph)) for id in group}
    return np.array([number.get(id, -1) for id in graph.viewpoints], np.float64)


def _storey(graph: NavGraph, known: QuantityInputs) -> Values:
    """1 for the lowest storey."""
    heights = np.array([v.height for v in graph.viewpoints.values()], np.float64)
    return storey_numbers(places_of(graph)[:, 2] - heights).astype(np.float64)


def _length(graph: NavGraph, known: QuantityInputs) -> Values:
    ends = places_of(graph)[edge_rows(graph)]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def _slope(graph: NavGraph, known: QuantityInputs) -> Values:
    """Degrees between the horizontal and the line from floor to floor."""
    feet = places_of(graph)
    feet[:, 2] -= [v.height for v in graph.viewpoints.values()]
    ends = feet[edge_rows(graph)]
    along = ends[:, 1] - ends[:, 0]
    return np.degrees(np.arctan2(np.abs(along[:, 2]), np.hypot(along[:, 0], along[:, 1])))


def clearness(graph: NavGraph, key: EdgeKey) -> float:
    """Return 1 minus the largest mean alpha of a row of the corridors along an edge: 1 if the path is clear, 0 if it is
    blocked, NaN without evidence."""
    shown = [one for e in evidence_along(graph, key) for one in (e, e.second) if one is not None]
    found = [float(one.alpha.mean(axis=1).max()) for one in shown if one.alpha.size]
    return 1.0 - max(found) / 255.0 if found else math.nan


def _alpha(graph: NavGraph, known: QuantityInputs) -> Values:
    return 1.0 - _clear(graph, known)


def _clear(graph: NavGraph, known: QuantityInputs) -> Values:
    of = known.clearness or clearness
    return np.array([of(graph, key) for key in graph.edges], np.float64)


def _evidence(graph: NavGraph, known: QuantityInputs) -> Values:
    if known.margin is None:
        return _clear(graph, known)
    return np.array([known.margin(graph, key) for key in graph.edges], np.float64)


def _viewpoint_evidence(graph: NavGraph, known: QuantityInputs) -> Values:
    """The smallest value of the viewpoint's edges."""
    least = np.full(len(graph.viewpoints), math.nan)
    values = _evidence(graph, known)
    for column in edge_rows(graph).T:
        rows = column[~np.isnan(values)]
        least[rows[np.isnan(least[rows])]] = math.inf
        np.minimum.at(least, rows, values[~np.isnan(values)])
    return least


def _map(known: QuantityInputs) -> OccupancyMap:
    if known.occupancy is None:
        raise EditError("Validity needs an occupancy map, and there is none.")
    return known.occupancy


def _is_on_free_cell(graph: NavGraph, known: QuantityInputs) -> Values:
    """1 on a free cell of the map, 0 on other cells."""
    return (_map(known).states_at(places_of(graph)[:, :2]) == FREE).astype(np.float64)


def _runs(graph: NavGraph, known: QuantityInputs) -> Values:
    """1 for an edge over free cells only, 0 for other edges."""
    from nvsim.occupancy.paths import segments_are_free, standing_room

    occupancy, ends = _map(known), places_of(graph)[edge_rows(graph)]
    return segments_are_free(standing_room(occupancy), occupancy, ends[:, 0, :2], ends[:, 1, :2]).astype(np.float64)


VIEWPOINTS: Mapping[str, _Quantity] = {
    "id": _of_viewpoint("id", str),
    "x": _axis(0),
    "y": _axis(1),
    "z": _axis(2),
    "height": _of_viewpoint("height", float),
    "submap": _of_viewpoint("submap", float),
    "included": _of_viewpoint("included", bool),
    "reviewed": _of_viewpoint("reviewed", bool),
    "locked": _of_viewpoint("locked", bool),
    "origin": _of_viewpoint("origin", str),
    "degree": _degree,
    "component": _component,
    "storey": _storey,
    "evidence": _viewpoint_evidence,
    "photographed": _of_viewpoint("photographed", float),
    "validity": _is_on_free_cell,
}
EDGES: Mapping[str, _Quantity] = {
    "x": _middle(0),
    "y": _middle(1),
    "z": _middle(2),
    "submap": _at_start(VIEWPOINTS["submap"]),
    "component": _at_start(_component),
    "storey": _at_start(_storey),
    "reviewed": _of_edge("reviewed", bool),
    "locked": _of_edge("locked", bool),
    "origin": _of_edge("origin", str),
    "length": _length,
    "slope": _slope,
    "alpha": _alpha,
    "evidence": _evidence,
    "validity": _runs,
}


Slope = Literal["level", "up", "down"]
_STEEP = 0.25  # rise per meter of edge, 14 degrees; ramps in buildings have 5 degrees
_STEP = 0.15  # meters: rise of a single step, which does not count as stairs


def slope_of(rise: float, meters: float) -> Slope:
    """Return the slope of an edge of `meters` meters whose end is `rise` meters higher than its beginning."""
    if abs(rise) <= max(_STEEP * meters, _STEP):
        return "level"
    return "up" if rise > 0 else "down"
