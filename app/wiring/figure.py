"""A figure for a paper: the map with the graph in its current colors, and a legend."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.look import lengths
from app.state.graph_coloring import Coloring
from nvsim.figures import DASHES, SHAPES
from nvsim.graph.exports import Groups, Key, draw
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import OccupancyMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(graph: NavGraph, occupancy: OccupancyMap | None, coloring: Coloring | None) -> Figure:
    """Draws `graph` as the window shows it. Without a coloring, the colors show the origin of the edges. Raises
    InputError if there is nothing to draw."""
    unit = lengths.unit()
    return draw(graph, occupancy, groups=_groups(coloring), unit=(unit.symbol, unit.metres))


def _groups(coloring: Coloring | None) -> Groups | None:
    """The groups of a coloring that have items, with their numbers."""
    if coloring is None:
        return None
    counts = coloring.counts.tolist()
    used = [i for i, count in enumerate(counts) if count]
    row = {number: i for i, number in enumerate(used)}
    keys = []
    for number in used:
        group = coloring.groups[number]
        shape = SHAPES[group.mark % len(SHAPES)] if number in coloring.viewpoints.values() else ""
        dash = group.mark % len(DASHES) if number in coloring.edges.values() else -1
        keys.append(Key(f"{group.words} ({counts[number]:,})", group.color, shape, dash))
    return Groups(
        coloring.title,
        tuple(keys),
        {id: row[n] for id, n in coloring.viewpoints.items() if n in row},
        {key: row[n] for key, n in coloring.edges.items() if n in row},
    )
