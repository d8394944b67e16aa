"""Who sees whom, asked of an occupancy map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import Visible
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.types import OccupancyMap

FARTHEST_SEEN = 16.0
"""Metres up to which R2R's `visible` is told; the depth files of a scan end there too."""
_ONE_FLOOR = 1.0  # metres of height between two viewpoints of one floor, at most


def sight_on(occupancy: OccupancyMap, radius: float = 0.0) -> Visible:
    """Two places see each other when a disc of `radius` metres can go straight from one to the other on the map, over
    free cells only. The map knows one floor."""
    from nvsim.occupancy.paths import segments_are_free, standing_room

    room = standing_room(occupancy, radius)

    def visible(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        return segments_are_free(room, occupancy, a[:, :2], b[:, :2])

    return visible


def lines_of_sight(graph: NavGraph, occupancy: OccupancyMap | None) -> Callable[[Viewpoint, Viewpoint], bool] | None:
    """(viewpoint, other) -> whether R2R's `visible` holds the other: they are joined, or on one floor, less than
    16 m apart, with nothing but free cells of the map between them. None without a map. Quick where one viewpoint
    is asked about all others before the next."""
    if occupancy is None:
        return None
    seen, row = sight_on(occupancy), {id: i for i, id in enumerate(graph.viewpoints)}
    places = np.array([v.position for v in graph.viewpoints.values()], np.float64).reshape(-1, 3)
    near: dict[str, set[str]] = {}
    for a, b in graph.edges:
        near.setdefault(a, set()).add(b)
        near.setdefault(b, set()).add(a)
    last: tuple[str, NDArray[np.bool_]] = ("", np.zeros(0, np.bool_))

    def visible(viewpoint: Viewpoint, other: Viewpoint) -> bool:
        nonlocal last
        if last[0] != viewpoint.id:
            here = places[row[viewpoint.id]]
            asked = (np.linalg.norm(places - here, axis=1) < FARTHEST_SEEN) & (abs(places - here)[:, 2] < _ONE_FLOOR)
            asked[asked] = seen(np.broadcast_to(here, (int(asked.sum()), 3)), places[asked])
            last = viewpoint.id, asked
        return other.id in near.get(viewpoint.id, ()) or bool(last[1][row[other.id]])

    return visible
