"""The names of near viewpoints. If two names overlap, only the nearer one is shown."""

from __future__ import annotations

import re

from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QColor, QPainter

from nvsim.geometry.camera import Camera
from nvsim.graph.types import NavGraph
from nvsim_app.layers.graph import GraphLayer
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.look.plain_text import plain
from nvsim_app.look.theme import type_font
from nvsim_app.painting.primitives import chip_box, paint_label
from nvsim_app.state.document import Document

_ID = re.compile(r"\b[0-9a-f]{8,32}\b")  # an id, or its beginning in a message of a command
LABEL_DISTANCE = 6.0  # meters
MOST_LABELS = 24
_LEAST = 6  # minimum number of characters of a shortened id


class LabelLayer(Layer):
    """The names of the viewpoints that the layer `graph` paints."""

    name = "labels"
    title = "Labels"

    def __init__(self, document: Document, graph: GraphLayer) -> None:
        self._document, self._graph = document, graph

    @property
    def missing(self) -> str:
        return self._graph.missing

    def paint(self, painter: QPainter, camera: Camera) -> None:
        arrays, graph = self._document.shown_arrays, self._document.graph
        if not arrays.ids or not self._graph.shown:
            return
        view = self._graph.projected_viewpoints(camera)
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self._graph.hovered or "")
        hidden = self._graph.hidden(view)
        near = view.order[(view.depths[view.order] < LABEL_DISTANCE) & ~hidden[view.order]][-MOST_LABELS:].tolist()
        rows = dict.fromkeys([*(r for r in (selected, hovered) if r is not None and view.seen[r]), *reversed(near)])
        painter.setFont(type_font("small"))
        drawn: list[QRectF] = []
        for row in rows:
            anchor = QPointF(view.pixels[row, 0] + view.radii[row, 0] + 4, view.pixels[row, 1] + 8)
            if any(chip_box(painter, anchor, short_id(graph, arrays.ids[row])).intersects(box) for box in drawn):
                continue
            fill = QColor(58, 44, 5, 220) if row == selected else QColor(16, 20, 26, 170)
            ink = QColor(colors.SELECTED if row == selected else "#dfe7ee")
            drawn.append(paint_label(painter, anchor, short_id(graph, arrays.ids[row]), ink, fill))


def short_ids(graph: NavGraph | None, sentence: str) -> str:
    """Replaces all viewpoint ids in the sentence, and their beginnings, by their short names."""
    return _ID.sub(lambda id: short_id(graph, id.group().ljust(32, "…")).rstrip("…"), sentence)


def short_id(graph: NavGraph | None, id: str) -> str:
    """The shortest beginning of a viewpoint id that is unique in the graph."""
    return plain(NavGraph("").short(id, _LEAST) if graph is None else graph.short(id, _LEAST))
