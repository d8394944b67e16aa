"""An image of the graph on its map, seen from above with y up: SVG for papers, PNG for everything else."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.graph.exports.characters import legal
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

Colour = tuple[int, int, int]  # red, green, blue
_PAPER, _INK = (255, 255, 255), (70, 70, 70)
_STATES: dict[int, Colour] = {int(FREE): (252, 252, 252), int(OCCUPIED): (70, 70, 70), int(UNKNOWN): (222, 224, 228)}
_EDGES: dict[str, Colour] = {"step": (46, 125, 84), "merge": (122, 90, 168), "person": (25, 105, 200)}
_OTHER: Colour = (60, 110, 130)
_NODE, _START, _EXCLUDED = (24, 78, 52), (225, 130, 20), (150, 150, 150)
_MARGIN = 0.8  # metres around everything
_BARS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200)  # metres that a scale bar may stand for
_LARGEST = 16_384  # pixels of a side


@dataclass(frozen=True)
class Line:
    """Pixels from (x, y) to (x, y)."""

    a: tuple[float, float]
    b: tuple[float, float]
    colour: Colour
    width: float


@dataclass(frozen=True)
class Dot:
    """A disc, or a ring for what is excluded; pixels."""

    at: tuple[float, float]
    radius: float
    colour: Colour
    filled: bool
    name: str


@dataclass(frozen=True, eq=False)
class Picture:
    """width, height pixels; ground (height, width, 3) uint8 RGB, None for plain paper; bar: its length in pixels and
    its words."""

    width: int
    height: int
    ground: NDArray[np.uint8] | None
    lines: tuple[Line, ...]
    dots: tuple[Dot, ...]
    bar: tuple[float, str]
    scan: str


def draw(graph: NavGraph, occupancy: OccupancyMap | None = None, longest_side: int = 1600) -> Picture:
    """The image as lines and dots; lines are coloured by who made the edge: steps green, merges violet, a user's blue.
    Raises InputError when there is nothing to draw, or the side is not between 64 and 16,384 pixels."""
    if not 64 <= longest_side <= _LARGEST:
        raise InputError(f"An image cannot be {longest_side} pixels wide; choose 64 to {_LARGEST}.")
    places = np.array([v.position[:2] for v in graph.viewpoints.values()], np.float64).reshape(-1, 2)
    low, high = _extent(occupancy, places)
    scale = longest_side / float((high - low).max())
    width, height = (max(1, math.ceil(side * scale - 1e-9)) for side in high - low)

    def at(id: str) -> tuple[float, float]:
        x, y = graph.viewpoints[id].position[:2]
        return (float(x) - low[0]) * scale, (high[1] - float(y)) * scale

    # A viewpoint is as large as a person's shoulders, but to be seen on any map and apart on every one.
    radius = min(max(0.12 * scale, 2.0), 0.01 * longest_side)
    lines = []
    for (a, b), edge in graph.edges.items():
        walked = graph.viewpoints[a].included and graph.viewpoints[b].included
        colour = _EDGES.get(edge.origin, _OTHER) if walked else _EXCLUDED
        lines.append(Line(at(a), at(b), colour, max(0.4 * radius, 1.0)))
    dots = []
    for v in graph.viewpoints.values():
        colour = _EXCLUDED if not v.included else _START if v.origin == "start" else _NODE
        dots.append(Dot(at(v.id), radius, colour, v.included, v.id))
    metres = max((b for b in _BARS if b * scale <= 0.25 * width), default=_BARS[0])
    ground = None if occupancy is None else _ground(occupancy, low, high, scale, width, height)
    return Picture(width, height, ground, tuple(lines), tuple(dots), (metres * scale, f"{metres:g} m"), graph.scan)


def write_svg(picture: Picture, path: Path) -> Path:
    """Lines and discs stay vectors, with the ids as titles; the map is an image in it. Returns `path`. Raises
    InputError when the disk refuses."""
    p = picture
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{p.width}" height="{p.height}" '
        f'viewBox="0 0 {p.width} {p.height}">',
        f"<title>{escape(legal(p.scan))}</title>",
        f'<rect width="100%" height="100%" fill="{_hex(_PAPER)}"/>',
    ]
    if p.ground is not None:
        data = base64.b64encode(_png(p.ground)).decode()
        rows.append(f'<image width="{p.width}" height="{p.height}" href="data:image/png;base64,{data}"/>')
    rows.append('<g stroke-linecap="round">')
    for line in p.lines:
        (x0, y0), (x1, y1) = line.a, line.b
        rows.append(
            f'<line x1="{x0:.2f}" y1="{y0:.2f}" x2="{x1:.2f}" y2="{y1:.2f}" stroke="{_hex(line.colour)}" '
            f'stroke-width="{line.width:.2f}"/>'
        )
    rows.append("</g>")
    for dot in p.dots:
        paint = f'fill="{_hex(dot.colour)}"' if dot.filled else f'fill="none" stroke="{_hex(dot.colour)}"'
        x, y = dot.at
        rows.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{dot.radius:.2f}" {paint}><title>{escape(legal(dot.name))}</title></circle>')  # fmt: skip # noqa: E501
    x, y, length, size = _bar(p)
    rows.append(f'<path d="M{x:.1f} {y:.1f}h{length:.1f}" stroke="{_hex(_INK)}" stroke-width="{size / 5:.1f}"/>')
    rows.append(f'<text x="{x:.1f}" y="{y - size / 2:.1f}" font-family="sans-serif" font-size="{size:.1f}" fill="{_hex(_INK)}">{p.bar[1]}</text>')  # fmt: skip # noqa: E501
    rows.append("</svg>\n")
    atomic.write_text(path, "\n".join(rows))
    return path


def write_png(picture: Picture, path: Path) -> Path:
    """Returns `path`. Raises InputError when the disk refuses."""
    import cv2

    p = picture
    pixels = np.full((p.height, p.width, 3), _PAPER, np.uint8) if p.ground is None else p.ground.copy()

    def fixed(at: tuple[float, float]) -> tuple[int, int]:
        return round(at[0] * 16), round(at[1] * 16)  # sixteenths of a pixel: cv2's `shift` of 4

    for line in p.lines:
        cv2.line(pixels, fixed(line.a), fixed(line.b), line.colour, max(1, round(line.width)), cv2.LINE_AA, 4)
    for dot in p.dots:
        cv2.circle(pixels, fixed(dot.at), round(dot.radius * 16), dot.colour, -1 if dot.filled else 1, cv2.LINE_AA, 4)
    x, y, length, size = _bar(p)
    cv2.line(pixels, fixed((x, y)), fixed((x + length, y)), _INK, max(1, round(size / 5)), cv2.LINE_AA, 4)
    at = (round(x), round(y - size / 2))
    cv2.putText(pixels, p.bar[1], at, cv2.FONT_HERSHEY_SIMPLEX, size / 24, _INK, max(1, round(size / 14)), cv2.LINE_AA)
    atomic.write_bytes(path, _png(pixels))
    return path


def _bar(picture: Picture) -> tuple[float, float, float, float]:
    """Left end, line, length and size of the letters of the scale bar, pixels."""
    size = max(10.0, 0.014 * max(picture.width, picture.height))
    return size, picture.height - size, picture.bar[0], size


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
    """Lower and upper corner of the known part of the map and of all places, with a margin."""
    boxes = [places] if len(places) else []
    if occupancy is not None:
        rows, columns = np.nonzero(occupancy.cells != UNKNOWN)
        if len(rows):
            index = np.stack([columns, rows], axis=-1)
            boxes.append(np.stack([index.min(axis=0), index.max(axis=0) + 1]) * occupancy.resolution + occupancy.origin)
    if not boxes:
        raise InputError("There is neither a viewpoint nor a map to draw; name another graph.")
    everything = np.concatenate(boxes)
    return everything.min(axis=0) - _MARGIN, everything.max(axis=0) + _MARGIN


def _png(pixels: NDArray[np.uint8]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".png", pixels[..., ::-1])[1].tobytes())


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
