"""Whether agents can take every edge: whether its end is among the navigable locations of one of the 36 views.

Source: Matterport3DSimulator with restricted navigation, whose rule this is: a location is navigable where it lies, as
seen from above, within half the field of view of the heading, and that is taken as proportional to the width.
"""

from __future__ import annotations

import math

from nvsim.geometry.view_sweep import HEIGHT, VFOV, VIEWS, WIDTH, heading_and_elevation
from nvsim.graph.types import NavGraph


def edges_out_of_reach(graph: NavGraph) -> list[tuple[str, str]]:
    """Directed edges between included viewpoints that no view of the sweep offers: those to a place straight above,
    below, or the same."""
    found = []
    for edge in graph.edges.values():
        for a, b in ((edge.a, edge.b), (edge.b, edge.a)):
            start, end = graph.viewpoints[a], graph.viewpoints[b]
            if start.included and end.included and not _offered(start.position, end.position):
                found.append((a, b))
    return found


def _offered(start: tuple[float, float, float], end: tuple[float, float, float]) -> bool:
    x, y = end[0] - start[0], end[1] - start[1]
    length, least = math.hypot(x, y), math.cos(VFOV * WIDTH / HEIGHT / 2)
    if length == 0:
        return False
    headings = (heading_and_elevation(i)[0] for i in range(VIEWS))
    return any((x * math.sin(h) + y * math.cos(h)) / length >= least for h in headings)
