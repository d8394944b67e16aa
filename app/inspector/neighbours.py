"""Positions in a panorama: marks of the neighbors of a viewpoint, and regions of the floor."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor, QPainter, QPen

from app.inspector.state import Inspection
from app.look import colors, lengths
from app.painting.primitives import chip
from app.state.directions import Direction

_FINE = 14  # points per side of a region, because straight lines on the floor are curves in a panorama


def angles(points: NDArray[np.float64], eye: NDArray[np.float64], around: float = 0.0) -> NDArray[np.float64]:
    """(N, 2) heading and elevation in radians of world points (N, 3), seen from `eye` (3,); meters. The headings are
    within half a turn of `around`."""
    way = points - eye
    heading = np.arctan2(way[:, 0], way[:, 1])
    heading = (heading - around + math.pi) % (2 * math.pi) - math.pi + around
    return np.stack([heading, np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))], axis=1)


def fine(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) points of the closed outline with the corners (N, 3), with added points on each side."""
    share = np.linspace(0, 1, _FINE, endpoint=False)[:, None]
    following = np.roll(corners, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, following, strict=True)])


def met(found: Sequence[Direction], eye: NDArray[np.float64], heading: float, elevation: float) -> Direction | None:
    """The direction whose floor region the ray from `eye` (3,) at `heading` and `elevation` (radians) hits.

    If it hits several regions, the one whose center line is nearest; None if it hits none."""
    if elevation >= -1e-3:
        return None
    best, least = None, math.inf
    for direction in found:
        e = direction.evidence
        distance = float(eye[2] - direction.floor[0]) / math.tan(-elevation)
        turn = heading - e.heading
        along, across = distance * math.cos(turn), abs(distance * math.sin(turn))
        rows, cells = direction.explanation.corridor
        half = max(abs(cells.start - e.alpha.shape[1] / 2), abs(cells.stop - e.alpha.shape[1] / 2))
        inside = 0 <= along <= e.near + rows.stop * e.depth and across <= half * e.width / e.alpha.shape[1]
        # A step takes precedence over an edge corridor that covers it.
        if inside and across + 0.02 * (not direction.lattice) < least:
            best, least = direction, across + 0.02 * (not direction.lattice)
    return best


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
