"""Draw graphs on their maps, seen from above with y up, with a legend."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.figures import DASHES, LETTERS, WIDTH, add_scale_bar, style
from nvsim.graph.exports.formats import without_control_characters
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STATES = {int(FREE): (252, 252, 252), int(OCCUPIED): (70, 70, 70), int(UNKNOWN): (222, 224, 228)}
TRAJECTORY = "#5aaac8"
_EXCLUDED = "#969696"
_MARKERS = {"disc": "o", "square": "s", "diamond": "D", "triangle": "^", "point": "v", "cross": "P"}
_MARGIN = 0.8  # margin in meters
_GAP = 0.01  # between areas, as a share of the longest side
_LARGEST = 16_384  # maximum side in pixels
_JUMP = 2.0  # meters; longer parts of a trajectory are not drawn
Corner = NDArray[np.float64]
Pair = tuple[str, str]


@dataclass(frozen=True)
class LegendRow:
    """A row of the legend; it has no row if `words` is empty. `shape` is one of figures.SHAPES, "" without viewpoints.
    `dash` is an index of figures.DASHES, -1 without edges."""

    words: str
    color: str
    shape: str = "disc"
    dash: int = 0
    filled: bool = True


_NO_KEY = LegendRow("", _EXCLUDED)
KEYS = {
    "step": LegendRow("steps of the search", "#2e7d54", ""),
    "merge": LegendRow("merges", "#7a5aa8", ""),
    "person": LegendRow("made by a user", "#1969c8", ""),
    "other": LegendRow("other edges", "#3c6e82", ""),
    "out": LegendRow("not in navigation", _EXCLUDED, dash=2, filled=False),
    "start": LegendRow("start of the search", "#e18214", dash=-1),
    "node": LegendRow("viewpoints", "#184e34", dash=-1),
}
"""Groups by origin."""


@dataclass(frozen=True, eq=False)
class ColorGroups:
    """The meaning of colors. `viewpoints` maps ids and `edges` maps keys to rows of `keys`; all other elements are
    gray."""

    title: str
    keys: tuple[LegendRow, ...]
    viewpoints: Mapping[str, int]
    edges: Mapping[Pair, int]


@dataclass(frozen=True, eq=False)
class MapArea:
    """A part of a graph and its background.

    low, high    (2,) corners, meters
    viewpoints   ids, and edges: keys of what is drawn; edges may end outside
    background   a map, or (height, width, 3) uint8 RGB of the whole area, or None
    walk         (N, 2 or 3) positions of a trajectory, meters
    """

    low: Corner
    high: Corner
    viewpoints: Collection[str]
    edges: Collection[Pair]
    background: OccupancyMap | NDArray[np.uint8] | None = None
    walk: NDArray[np.floating] = field(default_factory=lambda: np.zeros((0, 2)))


def grouped(
    keys: Mapping[str, LegendRow], viewpoints: Mapping[str, str], edges: Mapping[Pair, str], *others: str
) -> ColorGroups:
    """Return groups from the name of the group of each element. Only keys with elements, and `others`, are kept."""
    used = [name for name in keys if name in {*edges.values(), *viewpoints.values(), *others}]
    row = {name: i for i, name in enumerate(used)}
    return ColorGroups(
        "",
        tuple(keys[name] for name in used),
        {id: row[name] for id, name in viewpoints.items()},
        {ends: row[name] for ends, name in edges.items()},
    )


def draw(
    graph: NavGraph,
    occupancy: OccupancyMap | None = None,
    longest_side: int = 1600,
    groups: ColorGroups | None = None,
    unit: tuple[str, float] = ("m", 1.0),
) -> Figure:
    """Draw a graph as lines and dots with a legend.

    Colors are those of `groups`. Without groups, the color of an edge shows its origin: steps green, merges violet,
    edges of users blue. `unit` is the unit of the scale bar: its symbol and its length in meters. Raises InputError if
    there is nothing to draw, or if `longest_side` is not 64 to 16,384 pixels.
    """
    if not 64 <= longest_side <= _LARGEST:
        raise InputError(f"An image cannot be {longest_side} pixels wide; choose 64 to {_LARGEST}.")
    places = np.array([v.position[:2] for v in graph.viewpoints.values()], np.float64).reshape(-1, 2)
    corners = extent(occupancy, places, _MARGIN)
    if corners is None:
        raise InputError("There is no viewpoint and no map to draw; choose another graph.")
    area = MapArea(*corners, graph.viewpoints, graph.edges, occupancy)
    return draw_areas(graph, [area], _by_origin(graph) if groups is None else groups, longest_side, unit)


def _by_origin(graph: NavGraph) -> ColorGroups:
    """Group edges by origin, and mark where the search began."""
    edges = {
        ends: (edge.origin if edge.origin in ("step", "merge", "person") else "other")
        if all(graph.viewpoints[end].included for end in ends)
        else "out"
        for ends, edge in graph.edges.items()
    }
    viewpoints = {
        v.id: "out" if not v.included else "start" if v.origin == "start" else "node" for v in graph.viewpoints.values()
    }
    return grouped(KEYS, viewpoints, edges)


def extent(
    occupancy: OccupancyMap | None, points: NDArray[np.floating], margin: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the lower and upper corner (2,) of the known part of the map and all points (N, 2), with a margin, meters;
    None if there is neither."""
    boxes = [points] if len(points) else []
    if occupancy is not None:
        rows, columns = np.nonzero(occupancy.cells != UNKNOWN)
        if len(rows):
            index = np.stack([columns, rows], axis=-1)
            boxes.append(np.stack([index.min(axis=0), index.max(axis=0) + 1]) * occupancy.resolution + occupancy.origin)
    if not boxes:
        return None
    everything = np.concatenate(boxes)
    return everything.min(axis=0) - margin, everything.max(axis=0) + margin


@style()
def draw_areas(
    graph: NavGraph,
    areas: Sequence[MapArea],
    groups: ColorGroups,
    longest_side: int = 1600,
    unit: tuple[str, float] = ("m", 1.0),
) -> Figure:
    """Draw areas side by side at one scale, with one legend below. `longest_side` of all areas together is in
    pixels."""
    import matplotlib
    from matplotlib.figure import Figure

    dpi = longest_side / WIDTH
    # Letters have their size on paper, and stay readable in small images.
    matplotlib.rcParams["font.size"] = max(LETTERS, 10 * 72 / dpi)
    sides = np.array([area.high - area.low for area in areas])
    gap = _GAP * longest_side
    gaps = gap * (len(areas) - 1)
    scale = (longest_side - gaps) / max(sides[:, 0].sum(), sides[:, 1].max())
    widths, heights = np.maximum(np.ceil(sides * scale - 1e-6), 1).T.tolist()
    width, height = round(sum(widths) + gaps), max(heights)
    # A viewpoint is as large as a person's shoulders, within limits that keep it visible and separate on every map.
    radius = min(max(0.12 * scale, 2.0), 0.01 * longest_side) * 72 / dpi
    figure = Figure((width / dpi, height / dpi), dpi, label=without_control_characters(graph.scan))
    whole = height + _add_legend(figure, groups)
    figure.set_size_inches(width / dpi * (1 + 1e-12), whole / dpi * (1 + 1e-12))  # rounded down to whole pixels
    left = 0.0
    for area, w, h in zip(areas, widths, heights, strict=True):
        axes = figure.add_axes(
            (left / width, 1 - h / whole, w / width, h / whole), xticks=(), yticks=(), label=str(left)
        )
        axes.set(xlim=(area.low[0], area.low[0] + w / scale), ylim=(area.high[1] - h / scale, area.high[1]))
        axes.spines[:].set_visible(False)
        _add_background(axes, area)
        _add_elements(axes, graph, area, groups, radius)
        left += w + gap
    add_scale_bar(figure.axes[0], unit)
    return figure


def _add_background(axes: Axes, area: MapArea) -> None:
    image, box = area.background, (*axes.get_xlim(), *axes.get_ylim())
    if isinstance(image, OccupancyMap):
        table = np.zeros((256, 3), np.uint8)
        table[list(_STATES)] = list(_STATES.values())
        axes.set_facecolor("#{:02x}{:02x}{:02x}".format(*_STATES[int(UNKNOWN)]))
        (x, y), (rows, columns) = image.origin, np.multiply(image.cells.shape, image.resolution)
        image, box = table[image.cells[::-1]], (x, x + columns, y, y + rows)
    if image is not None:
        limits = axes.axis()
        axes.imshow(image, extent=box, interpolation="nearest", aspect="auto")
        axes.axis(limits)


def _add_elements(axes: Axes, graph: NavGraph, area: MapArea, groups: ColorGroups, radius: float) -> None:
    """Add the trajectory, edges, and viewpoints with a `radius` in points."""
    from matplotlib.collections import LineCollection

    def key_of(row: int | None) -> LegendRow:
        return _NO_KEY if row is None else groups.keys[row]

    steps = np.stack([area.walk[:-1, :2], area.walk[1:, :2]], axis=1)
    steps = steps[np.linalg.norm(steps[:, 0] - steps[:, 1], axis=-1) < _JUMP]
    axes.add_collection(LineCollection(steps, linewidths=0.3 * radius, colors=TRAJECTORY), autolim=False)
    edges = [(ends, key_of(groups.edges.get(ends))) for ends in area.edges]
    for number, dash in enumerate(DASHES):
        mine = [(ends, key.color) for ends, key in edges if max(key.dash, 0) == number]
        if mine:
            lines = [[graph.viewpoints[id].position[:2] for id in ends] for ends, _ in mine]
            axes.add_collection(
                LineCollection(
                    lines,
                    linewidths=0.4 * radius,
                    colors=[color for _, color in mine],
                    linestyles=[(0, dash or None)],
                    capstyle="butt" if dash else "round",
                ),
                autolim=False,
            )
    viewpoints = [(graph.viewpoints[id], key_of(groups.viewpoints.get(id))) for id in area.viewpoints]
    for shape, marker in _MARKERS.items():
        dots = [(v, key.color) for v, key in viewpoints if (key.shape or "disc") == shape]
        if dots:
            axes.scatter(
                [v.position[0] for v, _ in dots],
                [v.position[1] for v, _ in dots],
                s=(2 * radius) ** 2,
                marker=marker,
                facecolors=[color if v.included else "none" for v, color in dots],
                edgecolors=["none" if v.included else color for v, color in dots],
                linewidths=0.25 * radius,
                zorder=2,
                urls=[without_control_characters(v.id) for v, _ in dots],
            )


def _add_legend(figure: Figure, groups: ColorGroups) -> float:
    """Add a legend at the lower edge in as many columns as fit. Return its height in pixels."""
    from matplotlib.lines import Line2D

    rows = [
        Line2D(
            [],
            [],
            color=key.color,
            linewidth=1.2,
            linestyle="none" if key.dash < 0 else (0, DASHES[key.dash]) if DASHES[key.dash] else "-",
            marker=_MARKERS.get(key.shape, "none"),
            markersize=5,
            markerfacecolor=key.color if key.filled else "none",
            label=without_control_characters(key.words),
        )
        for key in groups.keys
        if key.words
    ]
    for columns in range(min(len(rows), 6), 0, -1):
        legend = figure.legend(
            handles=rows, loc="lower left", ncols=columns, title=groups.title or None, alignment="left",
            borderaxespad=0.4, handlelength=2.8,
        )  # fmt: skip
        box = legend.get_window_extent()
        if box.width < figure.bbox.width or columns == 1:
            return float(np.ceil(box.height + 2 * box.y0))
        legend.remove()
    return 0.0
