"""Ways of one length between the same viewpoints, and which edges to leave out so that the shortest way is one.

Agents are taught along the shortest path; where two are equally short, one of them is called wrong.
"""

from __future__ import annotations

import math

from nvsim.graph.ways import SAME_LENGTH
from nvsim.mapping.ways import Ways

_FAR = 12.0  # metres: ways that part and meet again do so within


def untie(ways: Ways) -> None:
    """Takes edges out until of two ways that part and meet again one is shorter by a centimetre, as far as the edges
    can be spared. Each is the last of one of the two ways, the longer first. Looks at ways of up to 12 m, from one
    viewpoint after the other."""
    waiting = set(ways)
    while waiting:  # an edge less may tie what was not
        for start in sorted(ways):
            while start in waiting:
                touched = _untie_from(ways, start)
                if touched:
                    waiting |= touched
                else:
                    waiting.remove(start)


def _untie_from(ways: Ways, start: str) -> set[str]:
    """Takes one edge out and returns the viewpoints whose ways within 12 m may have led over it; none where the ways
    from `start` are tied no more, or none can be spared."""
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
    """The viewpoints before `end` on ways from the start that are as short as the shortest, the farthest from it
    first."""
    edges = [(length, id) for id, length in ways.around(end) if metres.get(id, math.inf) < metres[end]]
    return [id for length, id in sorted(edges, reverse=True) if metres[id] + length <= metres[end] + SAME_LENGTH]
