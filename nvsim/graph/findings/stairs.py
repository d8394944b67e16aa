"""The slope of an edge, alone and as a part of stairs. Viewpoints on stairs are on single steps, so one edge is often
steeper than the flight it belongs to."""

from __future__ import annotations

import math

from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint

_CLIMBS = 0.1  # minimum rise in meters of an edge of a flight


def slope(graph: NavGraph, key: EdgeKey) -> float:
    """Return the degrees between the horizontal and the line from floor to floor."""
    rise, run = _way(graph.viewpoints[key[0]], graph.viewpoints[key[1]])
    return math.degrees(math.atan2(abs(rise), run))


def flight_slope(graph: NavGraph, key: EdgeKey) -> float:
    """Return the slope in degrees of an edge together with two adjoining edges: the one that climbs most from its upper
    end, and the one that descends most from its lower end. Without such edges, it is the slope of the edge alone."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    rise, run = _way(a, b)
    low, high = (a, b) if rise >= 0 else (b, a)
    rise = abs(rise)
    for end, before, sign in ((high, low, 1.0), (low, high, -1.0)):
        ways = [
            _way(end, graph.viewpoints[id])
            for id in graph.neighbours(end.id)
            if id != before.id and graph.viewpoints[id].included
        ]
        up, along = max(((sign * r, n) for r, n in ways), default=(0.0, 0.0))
        if up > _CLIMBS:
            rise, run = rise + up, run + along
    return math.degrees(math.atan2(rise, run))


def _way(a: Viewpoint, b: Viewpoint) -> tuple[float, float]:
    """Rise of the floor from a to b, and distance between them seen from above, meters."""
    rise = (b.position[2] - b.height) - (a.position[2] - a.height)
    return rise, math.hypot(b.position[0] - a.position[0], b.position[1] - a.position[1])
