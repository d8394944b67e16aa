"""Draw the graph on its map, seen from above with y up, and its legend, as lines, dots and text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

Colour = tuple[int, int, int]  # red, green, blue
PAPER, INK = (255, 255, 255), (70, 70, 70)
_STATES: dict[int, Colour] = {int(FREE): (252, 252, 252), int(OCCUPIED): (70, 70, 70), int(UNKNOWN): (222, 224, 228)}
_EDGES: dict[str, Colour] = {"step": (46, 125, 84), "merge": (122, 90, 168), "person": (25, 105, 200)}
_ORIGINS = {"step": "steps of the search", "merge": "merges", "person": "made by a user"}
_OTHER: Colour = (60, 110, 130)
_NODE, _START, _EXCLUDED = (24, 78, 52), (225, 130, 20), (150, 150, 150)
_MARGIN = 0.8  # margin in meters
_BARS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200)  # possible lengths of the scale bar, in its unit
_LARGEST = 16_384  # maximum side in pixels


@dataclass(frozen=True)
class Line:
    """A line from pixel (x, y) to pixel (x, y)."""

    a: tuple[float, float]
    b: tuple[float, float]
    colour: Colour
    width: float
    dash: int = 0  # index of marks.DASHES


@dataclass(frozen=True)
class Dot:
    """A disc or another shape of marks.SHAPES, in pixels. Excluded viewpoints are outlines."""

    at: tuple[float, float]
    radius: float
    colour: Colour
    filled: bool
    name: str
    shape: str = "disc"


@dataclass(frozen=True)
class Key:
    """A row of the legend. `shape` is one of marks.SHAPES, "" without viewpoints. `dash` is an index of marks.DASHES,
    -1 without edges."""

    words: str
    colour: Colour
    shape: str = "disc"
    dash: int = 0
    filled: bool = True


@dataclass(frozen=True, eq=False)
class Groups:
    """The meaning of colors. `viewpoints` maps ids and `edges` maps keys to rows of `keys`; all other elements are
    gray."""

    title: str
    keys: tuple[Key, ...]
    viewpoints: Mapping[str, int]
    edges: Mapping[tuple[str, str], int]


@dataclass(frozen=True, eq=False)
class Picture:
    """An image of a graph as shapes.

    width, height  pixels, without the legend below
    ground         (height, width, 3) uint8 RGB, None for plain paper
    bar            length in pixels and text of the scale bar
    """

    width: int
    height: int
    ground: NDArray[np.uint8] | None
    lines: tuple[Line, ...]
    dots: tuple[Dot, ...]
    bar: tuple[float, str]
    scan: str
    title: str = ""  # of the legend
    legend: tuple[Key, ...] = ()

    @property
    def size(self) -> float:
        """Height of the letters in pixels."""
        return max(10.0, 0.014 * max(self.width, self.height))

    @property
    def whole_height(self) -> int:
        """Height in pixels, including the legend."""
        if not self.legend:
            return self.height
        return self.height + math.ceil(1.6 * self.size * (len(self.legend) + bool(self.title)) + 0.8 * self.size)

    def row(self, number: int) -> float:
        """Return y in pixels of the middle of a row of the legend. Its title is row 0."""
        return self.height + 1.6 * self.size * (number + (0.5 if self.title else -0.5)) + 0.4 * self.size


def draw(
    graph: NavGraph,
    occupancy: OccupancyMap | None = None,
    longest_side: int = 1600,
    groups: Groups | None = None,
    unit: tuple[str, float] = ("m", 1.0),
) -> Picture:
    """Draw a graph as lines and dots with a legend.

    Colors are those of `groups`. Without groups, the color of an edge shows its origin: steps green, merges violet,
    edges of users blue. `unit` is the unit of the scale bar: its symbol and its length in meters. Raises InputError if
    there is nothing to draw, or if `longest_side` is not 64 to 16,384 pixels.
    """
    if not 64 <= longest_side <= _LARGEST:
        raise InputError(f"An image cannot be {longest_side} pixels wide; choose 64 to {_LARGEST}.")
    places = np.array([v.position[:2] for v in graph.viewpoints.values()], np.float64).reshape(-1, 2)
    low, high = _extent(occupancy, places)
    scale = longest_side / float((high - low).max())
    width, height = (max(1, math.ceil(side * scale - 1e-9)) for side in high - low)

    def at(id: str) -> tuple[float, float]:
        x, y = graph.viewpoints[id].position[:2]
        return (float(x) - low[0]) * scale, (high[1] - float(y)) * scale

    # A viewpoint is as large as a person's shoulders, within limits that keep it visible and separate on every map.
    radius = min(max(0.12 * scale, 2.0), 0.01 * longest_side)
    grouping = _by_origin(graph) if groups is None else groups
    lines = []
    for ends in graph.edges:
        key = grouping.keys[grouping.edges[ends]] if ends in grouping.edges else _NO_KEY
        lines.append(Line(at(ends[0]), at(ends[1]), key.colour, max(0.4 * radius, 1.0), max(key.dash, 0)))
    dots = []
    for v in graph.viewpoints.values():
        key = grouping.keys[grouping.viewpoints[v.id]] if v.id in grouping.viewpoints else _NO_KEY
        dots.append(Dot(at(v.id), radius, key.colour, v.included, v.id, key.shape or "disc"))
    symbol, metres = unit
    length = max((b for b in _BARS if b * metres * scale <= 0.25 * width), default=_BARS[0])
    ground = None if occupancy is None else _ground(occupancy, low, high, scale, width, height)
    bar = (length * metres * scale, f"{length:g} {symbol}")
    return Picture(width, height, ground, tuple(lines), tuple(dots), bar, graph.scan, grouping.title, grouping.keys)


_NO_KEY = Key("", _EXCLUDED)


def _by_origin(graph: NavGraph) -> Groups:
    """Group edges by origin, and mark where the search began. Only rows with elements are returned."""
    keys = {
        **{origin: Key(words, _EDGES[origin], "", 0) for origin, words in _ORIGINS.items()},
        "other": Key("other edges", _OTHER, "", 0),
        "out": Key("not in navigation", _EXCLUDED, "disc", 2, filled=False),
        "start": Key("start of the search", _START, "disc", -1),
        "node": Key("viewpoints", _NODE, "disc", -1),
    }
    edges = {
        ends: (edge.origin if edge.origin in _ORIGINS else "other")
        if all(graph.viewpoints[end].included for end in ends)
        else "out"
        for ends, edge in graph.edges.items()
    }
    viewpoints = {
        v.id: "out" if not v.included else "start" if v.origin == "start" else "node" for v in graph.viewpoints.values()
    }
    used = [name for name in keys if name in {*edges.values(), *viewpoints.values()}]
    row = {name: i for i, name in enumerate(used)}
    return Groups(
        "",
        tuple(keys[name] for name in used),
        {id: row[name] for id, name in viewpoints.items()},
        {ends: row[name] for ends, name in edges.items()},
    )


def _ground(
    occupancy: OccupancyMap, low: NDArray[np.float64], high: NDArray[np.float64], scale: float, width: int, height: int
) -> NDArray[np.uint8]:
    x = low[0] + (np.arange(width) + 0.5) / scale
    y = high[1] - (np.arange(height) + 0.5) / scale
    table = np.zeros((256, 3), np.uint8)
    for state, colour in _STATES.items():
        table[state] = colour
    return np.ascontiguousarray(table[occupancy.at(np.stack(np.meshgrid(x, y), axis=-1))])


def _extent(
    occupancy: OccupancyMap | None, places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2,) lower and (2,) upper corner of the known part of the map and all positions, with a margin, meters."""
    boxes = [places] if len(places) else []
    if occupancy is not None:
        rows, columns = np.nonzero(occupancy.cells != UNKNOWN)
        if len(rows):
            index = np.stack([columns, rows], axis=-1)
            boxes.append(np.stack([index.min(axis=0), index.max(axis=0) + 1]) * occupancy.resolution + occupancy.origin)
    if not boxes:
        raise InputError("There is no viewpoint and no map to draw; choose another graph.")
    everything = np.concatenate(boxes)
    return everything.min(axis=0) - _MARGIN, everything.max(axis=0) + _MARGIN
