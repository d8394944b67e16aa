"""Which viewpoints can reach each other."""

from __future__ import annotations

from nvsim.graph.types import NavGraph


def components(graph: NavGraph) -> list[list[str]]:
    """Ids of the included viewpoints, grouped by who can reach whom; the largest group first, ids in file order."""
    neighbours: dict[str, list[str]] = {id: [] for id, v in graph.viewpoints.items() if v.included}
    for a, b in graph.edges:
        if a in neighbours and b in neighbours:
            neighbours[a].append(b)
            neighbours[b].append(a)
    order = {id: i for i, id in enumerate(neighbours)}
    seen: set[str] = set()
    groups = []
    for start in neighbours:
        if start in seen:
            continue
        seen.add(start)
        group, front = [start], [start]
        while front:
            for id in neighbours[front.pop()]:
                if id not in seen:
                    seen.add(id)
                    group.append(id)
                    front.append(id)
        groups.append(sorted(group, key=order.__getitem__))
    return sorted(groups, key=lambda g: (-len(g), order[g[0]]))
