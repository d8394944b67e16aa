"""Marks of the neighbors of a viewpoint in its panorama, at their floor positions. A click goes to the neighbor. Does
not use widgets."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor, QPainter, QPen

from app.inspector.sphere import angles
from app.inspector.state import Inspection
from app.look import colors, lengths
from app.painting.primitives import chip

_REACH = 12.0  # radius around a mark that accepts a click, pixels
_SIZE = (5.0, 13.0)  # minimum and maximum radius of a mark, pixels
_NEAR = 16.0  # radius of a mark at a distance of one meter, pixels


class NeighbourMarks:
    """The marks of the neighbors of the inspected viewpoint. `hovered` is the viewpoint id under the cursor."""

    def __init__(self, inspection: Inspection) -> None:
        self._inspection = inspection
        self._pixels = np.zeros((0, 2))  # (N, 2) of the visible marks, from the last painting
        self._ids: list[str] = []
        self.hovered: str | None = None

    def under(self, point: QPointF) -> str | None:
        """The id of the neighbor whose mark is under `point`, None if there is none."""
        if not self._ids:
            return None
        distance = np.hypot(*(self._pixels - [point.x(), point.y()]).T)
        nearest = int(np.argmin(distance))
        return self._ids[nearest] if distance[nearest] <= _REACH else None

    def paint(self, painter: QPainter, middle: float, scale: float, height: int, heading: float, width: int) -> None:
        """Paints the marks in a view of `width` x `height` pixels, with `scale` pixels per radian. The center of the
        view is at `heading` and at elevation `middle`, in radians."""
        eye, found = self._inspection.eye, self._inspection.neighbours
        self._ids, places = [], []
        for id, foot in found:
            ((turn, elevation),) = angles(foot[None], eye, heading)
            x, y = width / 2 + (turn - heading) * scale, height / 2 - (elevation - middle) * scale
            if not (0 <= x <= width and 0 <= y <= height):
                continue
            self._ids.append(id)
            places.append((x, y))
            metres = math.dist(foot, eye)
            radius = min(max(_NEAR / max(metres, 0.1), _SIZE[0]), _SIZE[1]) * (1.3 if id == self.hovered else 1.0)
            painter.setPen(QPen(QColor("#20252b"), 3.6))
            painter.setBrush(QColor(colors.NODE))
            painter.drawEllipse(QPointF(x, y), radius, 0.5 * radius)
            painter.setPen(QPen(QColor("#ffffff"), 1.4))
            painter.drawEllipse(QPointF(x, y), radius, 0.5 * radius)
            if id == self.hovered:
                chip(
                    painter,
                    QPointF(x + 14, y + 5),
                    f"{self._inspection.name_of(id)}, {lengths.length(metres, 1)}",
                    QColor("#e8edf2"),
                    QColor("#20252b"),
                )
        self._pixels = np.array(places).reshape(-1, 2)
