"""Check that agents can use every edge: its end must be a navigable location in one of the 36 views.

Source: the rule of Matterport3DSimulator with restricted navigation. A location is navigable if its horizontal
direction is within half the field of view of the heading. The field of view is taken as proportional to the width.
"""

from __future__ import annotations

import math

from nvsim.geometry.view_sweep import HEIGHT, VFOV, VIEWS, WIDTH, heading_and_elevation
from nvsim.graph.types import NavGraph


def edges_out_of_reach(graph: NavGraph) -> list[tuple[str, str]]:
    """Directed edges between included viewpoints that no view of the sweep offers. Their end is straight above or
    below, or at an equal position."""
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
