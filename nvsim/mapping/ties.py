"""Ways of one length between the same viewpoints, and which edges to leave out so that the shortest way is one.

Agents are taught along the shortest path; where two are equally short, one of them is called wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

SAME_LENGTH = 0.01  # metres
_FAR = 12.0  # metres: ways that part and meet again do so within


def untie(ways: Any, spare: Callable[[str, str], bool]) -> list[tuple[str, str]]:
    """Takes edges out of a networkx graph, weighted by metres, until of two ways that part and meet again one is
    shorter by a centimetre, as far as `spare` allows; the edges taken. Each is the last of one of the two ways, the
    longer first. Looks at ways of up to 12 m, one viewpoint after the other."""
    import networkx as nx

    taken = []
    for start in sorted(ways):
        again = True
        while again:
            again = False
            metres = nx.single_source_dijkstra_path_length(ways, start, cutoff=_FAR)
            for end in sorted(metres, key=lambda id: (metres[id], id)):
                last = _last(ways, metres, end)
                for before in last if len(last) > 1 else []:
                    if spare(before, end):
                        ways.remove_edge(before, end)
                        taken.append((min(before, end), max(before, end)))
                        again = True
                        break
                if again:
                    break
    return taken


def _last(ways: Any, metres: dict[str, float], end: str) -> list[str]:
    """The viewpoints before `end` on ways from the start that are as short as the shortest, the farthest from it
    first."""
    edges = [(data["weight"], id) for id, data in ways[end].items() if metres.get(id, math.inf) < metres[end]]
    return [id for length, id in sorted(edges, reverse=True) if metres[id] + length <= metres[end] + SAME_LENGTH]
