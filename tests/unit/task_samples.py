"""Houses of rooms with doors, and their exports, for tests of tasks, agents and metrics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import networkx as nx
import numpy as np

from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge


def house(scan: str, rooms: int = 5, side: int = 4, seed: int = 0, even: bool = False) -> NavGraph:
    """Rooms in a row, each a lattice of `side` by `side` viewpoints, some 2 m apart (exactly 2 m if `even`), one door
    from room to room. Ids begin with the room's number."""
    random = np.random.default_rng(seed)
    viewpoints, edges = {}, []
    for room in range(rooms):
        for i in range(side):
            for j in range(side):
                id = f"{room}r{i}{j}"
                moved = np.zeros(2) if even else random.uniform(-0.3, 0.3, 2)
                x, y = 2.0 * (room * (side + 1) + i) + moved[0], 2.0 * j + moved[1]
                viewpoints[id] = Viewpoint(id, (float(x), float(y), 1.5))
                edges += [(f"{room}r{i - 1}{j}", id)] * (i > 0) + [(f"{room}r{i}{j - 1}", id)] * (j > 0)
        edges += [(f"{room - 1}r{side - 1}0", f"{room}r00")] * (room > 0)
    return NavGraph(scan, viewpoints, {edge(*pair).key: edge(*pair) for pair in edges})


def without(graph: NavGraph, *ids: str) -> NavGraph:
    """The graph with these viewpoints left out of navigation."""
    viewpoints = {id: replace(v, included=v.included and id not in ids) for id, v in graph.viewpoints.items()}
    return replace(graph, viewpoints=viewpoints)


def exported(folder: Path, *graphs: NavGraph) -> Path:
    for graph in graphs:
        write_connectivity(graph, folder / "connectivity")
    return folder


def as_agents_load(graph: NavGraph) -> nx.Graph:
    """As the agents' `load_nav_graphs` does: included viewpoints with edges alone, weights in meters of space."""
    found = nx.Graph()
    at = {id: np.array(v.position) for id, v in graph.viewpoints.items() if v.included}
    for a, b in graph.edges:
        if a in at and b in at:
            found.add_edge(a, b, weight=float(np.linalg.norm(at[a] - at[b])))
    return found
