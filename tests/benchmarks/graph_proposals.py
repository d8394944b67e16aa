"""Measure the seconds to propose edges and viewpoints: `python tests/benchmarks/graph_proposals.py [VIEWPOINTS ...]`.

The map is a grid of rooms of 6 m with doors, at 5 cm per cell. Random viewpoints are in four of five rooms, so that
every fifth room is not covered. The first call compiles the code and is not counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
import tyro
from harness import report, timed

from nvsim.graph.proposals import propose_edges, propose_viewpoints
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap

ROOM, CELL, EACH = 6.0, 0.05, 6  # meters, meters, viewpoints in a room


@dataclass(frozen=True)
class Arguments:
    viewpoints: tyro.conf.Positional[tuple[int, ...]] = (1000, 10000)


def rooms(across: int) -> OccupancyMap:
    size, door = round(ROOM / CELL), round(1.0 / CELL)
    cells = np.full((across * size + 1, across * size + 1), FREE, np.uint8)
    cells[::size], cells[:, ::size] = OCCUPIED, OCCUPIED
    for k in range(across):
        middle = slice(k * size + size // 2 - door // 2, k * size + size // 2 + door // 2)
        cells[size:-1:size, middle], cells[middle, size:-1:size] = FREE, FREE
    return OccupancyMap(cells, CELL, (0.0, 0.0))


def building(count: int) -> tuple[NavGraph, OccupancyMap]:
    across = math.ceil(math.sqrt(count / EACH * 5 / 4))
    rng = np.random.default_rng(1)
    corners = [(r, c) for r in range(across) for c in range(across) if (r + 2 * c) % 5]
    viewpoints = {}
    for i in range(count):
        corner = np.array(corners[i // EACH % len(corners)]) * ROOM
        x, y = (corner + rng.uniform(0.5, ROOM - 0.5, 2)).tolist()
        viewpoints[f"{i:032x}"] = Viewpoint(f"{i:032x}", (x, y, 1.5))
    return NavGraph("rooms", viewpoints), rooms(across)


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    graph, occupancy = building(12)
    propose_edges(graph, occupancy)
    propose_viewpoints(graph, occupancy)
    for count in arguments.viewpoints:
        graph, occupancy = building(count)
        edges, edges_s = timed(partial(propose_edges, graph, occupancy))
        places, viewpoints_s = timed(partial(propose_viewpoints, graph, occupancy))
        figures = {
            "viewpoints": count,
            "cells": occupancy.cells.size,
            "edges_s": round(edges_s, 2),
            "edges": len(edges),
            "viewpoints_s": round(viewpoints_s, 2),
            "proposed": len(places),
        }
        report(figures, as_json=True)


if __name__ == "__main__":
    main()
