"""Find paths of equal length between two viewpoints, and remove edges so that the shortest path is unique.

Agents are trained on the shortest path. If two paths are equally short, one of them is scored as wrong.
"""

from __future__ import annotations

import math

from nvsim.graph.ways import SAME_LENGTH
from nvsim.mapping.ways import Ways

_FAR = 12.0  # meters: maximum length of paths that part and meet again


def untie(ways: Ways) -> None:
    """Remove edges until, of two paths that part and meet again, one is shorter by a centimeter, as far as edges can be
    spared. Each removed edge is the last one of such a path, the longer edge first. Paths of up to 12 m are examined,
    from one viewpoint after the other."""
    waiting = set(ways)
    while waiting:  # a removed edge can cause new ties
        for start in sorted(ways):
            while start in waiting:
                touched = _untie_from(ways, start)
                if touched:
                    waiting |= touched
                else:
                    waiting.remove(start)


def _untie_from(ways: Ways, start: str) -> set[str]:
    """Remove one edge, and return the viewpoints with paths within 12 m that may have used it. Returns an empty set if
    no paths from `start` are tied, or if no edge can be spared."""
    metres = ways.all_metres(start, _FAR)
    for end in sorted(metres, key=lambda id: (metres[id], id)):
        last = _last(ways, metres, end)
        for before in last if len(last) > 1 else []:
            if ways.can_spare_edge(before, end):
                touched = {id for side in (before, end) for id in ways.all_metres(side, _FAR + SAME_LENGTH)}
                ways.cut(before, end)
                return touched
    return set()


def _last(ways: Ways, metres: dict[str, float], end: str) -> list[str]:
    """Return the viewpoints before `end` on paths from the start that are as short as the shortest, the farthest from
    `end` first."""
    edges = [(length, id) for id, length in ways.around(end) if metres.get(id, math.inf) < metres[end]]
    return [id for length, id in sorted(edges, reverse=True) if metres[id] + length <= metres[end] + SAME_LENGTH]
