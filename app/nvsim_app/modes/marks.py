"""Marks in every view: rings around selected viewpoints, bright selected edges, ticks for reviewed items, and locks.

All marks of the selection take two drawing calls. The sets of reviewed and locked items are updated with every edit. If
there are too many marks to see the graph, none are drawn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPixmap

from nvsim.graph.difference import Difference
from nvsim.graph.types import Edge, EdgeKey, NavGraph, Viewpoint
from nvsim_app.look import colors
from nvsim_app.painting.picking import NEAR
from nvsim_app.painting.primitives import Primitives, disc
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays
from nvsim_app.views.graph_surface import GraphSurface

_SMOOTH = 2000  # lines; more are drawn without antialiasing, which would be too slow


class SelectionMarks:
    """Draws the marks of the selection."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._disc = disc(colors.SELECTED, "#3a2c05", 16)

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        chosen, arrays = self._document.editing.selection, self._document.shown_arrays
        if chosen.edges:
            ends = arrays.feet[arrays.edges[arrays.edge_rows(chosen.edges)]]
            lines, _, _ = surface.segments(ends[:, 0], ends[:, 1])
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < _SMOOTH)
            pen = QPen(QColor(colors.SELECTED), 3.6)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            self._primitives.draw_lines(painter, lines)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if chosen.viewpoints:
            pixels, depths = surface.project(arrays.feet[arrays.viewpoint_rows(chosen.viewpoints)])
            seen = depths > NEAR
            size = 0.75 if len(pixels) < 200 else 0.5
            self._primitives.draw_sprites(painter, pixels[seen], np.full((int(seen.sum()), 2), size), self._disc)


MOST = 600  # marks; more would hide the graph
_SIZE = 13  # pixels
Name = str | EdgeKey


class ReviewMarks:
    """Draws the marks of reviewed and locked items."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._reviewed: set[Name] = set()
        self._locked: set[Name] = set()
        self._drawn: tuple[GraphArrays | None, NDArray[np.float64], NDArray[np.float64]] = (None, _NO, _NO)
        self._tick, self._lock = _tick(), _lock()
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._update_marks)
        self._read(document.graph)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self._read(self._document.graph)

    def _read(self, graph: NavGraph | None) -> None:
        things: list[tuple[Name, Viewpoint | Edge]] = []
        if graph is not None:
            things = [*graph.viewpoints.items(), *graph.edges.items()]
        self._reviewed = {name for name, thing in things if thing.reviewed}
        self._locked = {name for name, thing in things if thing.locked}
        self._drawn = (None, _NO, _NO)

    def _update_marks(self, change: Difference) -> None:
        graph = self._document.graph
        if graph is None:
            return
        gone: set[Name] = {*change.removed_viewpoints, *change.removed_edges}
        self._reviewed -= gone
        self._locked -= gone
        ids, keys = (*change.added_viewpoints, *change.changed_viewpoints), (*change.added_edges, *change.changed_edges)
        things: list[tuple[Name, Viewpoint | Edge]] = [(id, graph.viewpoints[id]) for id in ids]
        things += [(key, graph.edges[key]) for key in keys]
        for name, thing in things:
            for marked, is_so in ((self._reviewed, thing.reviewed), (self._locked, thing.locked)):
                (marked.add if is_so else marked.discard)(name)
        self._drawn = (None, _NO, _NO)

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        arrays = self._document.shown_arrays
        if self._drawn[0] is not arrays:
            self._drawn = (arrays, self._places(arrays, self._reviewed), self._places(arrays, self._locked))
        for places, sprite, aside in ((self._drawn[1], self._tick, 7.0), (self._drawn[2], self._lock, -7.0)):
            if not len(places):
                continue
            pixels, depths = surface.project(places)
            seen = pixels[depths > NEAR] + [aside, -7.0]
            self._primitives.draw_sprites(painter, seen, np.ones((len(seen), 2)), sprite)

    def _places(self, arrays: GraphArrays, names: set[Name]) -> NDArray[np.float64]:
        """(N, 3) world positions on the floor in meters: the feet of viewpoints, the centers of edges."""
        if len(names) > MOST:
            return _NO
        index, feet = arrays.index, arrays.feet
        ends = [(name, name) if isinstance(name, str) else name for name in names]
        rows = [(index[a], index[b]) for a, b in ends if a in index and b in index]
        return feet[np.array(rows, np.int64).reshape(-1, 2)].mean(axis=1)


_NO: NDArray[np.float64] = np.zeros((0, 3))


def _sprite() -> tuple[QPixmap, QPainter]:
    sprite = QPixmap(2 * _SIZE, 2 * _SIZE)
    sprite.setDevicePixelRatio(2.0)
    sprite.fill(Qt.GlobalColor.transparent)
    painter = QPainter(sprite)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    return sprite, painter


def _tick() -> QPixmap:
    sprite, painter = _sprite()
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(colors.OPEN))
    painter.drawEllipse(QRectF(0.5, 0.5, _SIZE - 1, _SIZE - 1))
    painter.setPen(QPen(QColor("#ffffff"), 1.8))
    painter.drawPolyline([QPointF(3.6, 6.8), QPointF(5.7, 9.0), QPointF(9.6, 4.4)])
    painter.end()
    return sprite


def _lock() -> QPixmap:
    sprite, painter = _sprite()
    painter.setPen(QPen(QColor("#3a2c05"), 3.0))
    painter.drawArc(QRectF(4.0, 1.6, 5.0, 6.0), 0, 180 * 16)
    painter.setPen(QPen(QColor(colors.SELECTED), 1.6))
    painter.drawArc(QRectF(4.0, 1.6, 5.0, 6.0), 0, 180 * 16)
    painter.setPen(QPen(QColor("#3a2c05"), 1.0))
    painter.setBrush(QColor(colors.SELECTED))
    painter.drawRoundedRect(QRectF(2.5, 5.5, 8.0, 6.0), 1.2, 1.2)
    painter.end()
    return sprite
