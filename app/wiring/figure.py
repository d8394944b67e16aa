"""A figure for a paper: the map with the graph in its current colors, and a legend."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QMarginsF, QSizeF
from PySide6.QtGui import QColor, QPageSize, QPainter, QPdfWriter
from PySide6.QtSvg import QSvgRenderer

from app.look import lengths
from app.state.graph_coloring import Coloring
from nvsim.files import atomic
from nvsim.graph.exports import Groups, Key, Picture, draw, svg
from nvsim.graph.marks import DASHES, SHAPES
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import OccupancyMap

_WIDEST = 180.0  # millimeters on the page


def figure(graph: NavGraph, occupancy: OccupancyMap | None, coloring: Coloring | None) -> Picture:
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
        ink = QColor(group.color)
        shape = SHAPES[group.mark % len(SHAPES)] if number in coloring.viewpoints.values() else ""
        dash = group.mark % len(DASHES) if number in coloring.edges.values() else -1
        keys.append(Key(f"{group.words} ({counts[number]:,})", (ink.red(), ink.green(), ink.blue()), shape, dash))
    return Groups(
        coloring.title,
        tuple(keys),
        {id: row[n] for id, n in coloring.viewpoints.items() if n in row},
        {key: row[n] for key, n in coloring.edges.items() if n in row},
    )


def write_pdf(picture: Picture, path: Path) -> Path:
    """Writes one page in the size of the figure; lines and dots are vectors. Returns `path`. Raises InputError if the
    file cannot be written."""
    renderer = QSvgRenderer(QByteArray(svg(picture).encode()))
    data = QByteArray()
    buffer = QBuffer(data)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    writer = QPdfWriter(buffer)
    writer.setTitle(picture.scan)
    writer.setCreator("NVSim")
    share = _WIDEST / max(picture.width, picture.whole_height)
    size = QSizeF(picture.width * share, picture.whole_height * share)
    writer.setPageSize(QPageSize(size, QPageSize.Unit.Millimeter, "figure", QPageSize.SizeMatchPolicy.ExactMatch))
    writer.setPageMargins(QMarginsF())
    painter = QPainter(writer)
    renderer.render(painter)
    painter.end()
    buffer.close()
    atomic.write_bytes(path, bytes(data.data()))
    return path
