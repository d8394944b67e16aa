"""Lines of sight between viewpoints on an occupancy map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import Visible
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.types import OccupancyMap

FARTHEST_SEEN = 16.0
"""Maximum distance in meters of viewpoints in R2R's `visible`. The depth files of a scan end there too."""
_ONE_FLOOR = 1.0  # maximum height difference in meters of two viewpoints on one floor


def line_of_sight_test(occupancy: OccupancyMap) -> Visible:
    """Return a function that tests lines of sight from positions (N, 3) to positions (N, 3), meters, world: (N,) bool.
    Two positions see each other if the straight line between them is over free cells. The map covers one floor."""
    from nvsim.occupancy.paths import segments_are_free, standing_room

    room = standing_room(occupancy, 0.0)

    def visible(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        return segments_are_free(room, occupancy, a[:, :2], b[:, :2])

    return visible


def lines_of_sight(graph: NavGraph, occupancy: OccupancyMap | None) -> Callable[[Viewpoint, Viewpoint], bool] | None:
    """Return (viewpoint, other) -> whether R2R's `visible` lists the other viewpoint; None without a map.

    Two viewpoints see each other if they are joined. They also do if they are on one floor, less than 16 m apart, with
    only free cells between them. Calls are fast if all pairs of one viewpoint are tested before those of the next.
    """
    if occupancy is None:
        return None
    seen, row = line_of_sight_test(occupancy), {id: i for i, id in enumerate(graph.viewpoints)}
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
