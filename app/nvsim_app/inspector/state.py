"""The state of the inspector: the directions of the selected viewpoint and the highlighted one, and their positions in
its panorama."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QPointF, Signal
from PySide6.QtGui import QColor, QPainter, QPen

from nvsim.graph.difference import Difference
from nvsim.mapping.config import MappingConfig
from nvsim_app.layers.labels import short_id
from nvsim_app.look import colors, lengths
from nvsim_app.painting.primitives import paint_label
from nvsim_app.state.directions import Direction, directions
from nvsim_app.state.document import Document


class Inspection(QObject):
    """The directions of the selected viewpoint.

    changed()   the directions or their explanations changed
    pointed()   another direction is highlighted
    """

    changed = Signal()
    pointed = Signal()

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._preview: MappingConfig | None = None
        self.directions: tuple[Direction, ...] = ()
        self.viewpoint: str | None = None
        self.neighbors: tuple[tuple[str, NDArray[np.float64]], ...] = ()
        """The neighbors of the viewpoint: id and floor point (3,) in meters, world."""
        self.eye: NDArray[np.float64] = np.zeros(3)
        self._pointed: tuple[str, int] | None = None
        document.selectionChanged.connect(self.refresh)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        self.refresh()

    @property
    def config(self) -> MappingConfig:
        """The thresholds of the explanations: those of the preview, else those of the project."""
        return self._preview or self._document.contents.thresholds

    def name_of(self, id: str) -> str:
        """The short name of a viewpoint in the window."""
        return short_id(self._document.graph, id)

    def try_out(self, config: MappingConfig | None) -> None:
        """Explains the directions with other thresholds; None restores those of the project."""
        if config != self._preview:
            self._preview = config
            self.refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self.refresh()

    def _on_edit(self, change: Difference) -> None:
        self.refresh()

    def refresh(self) -> None:
        """Updates the directions from the selected viewpoint."""
        viewpoint, graph = self._document.selected_viewpoint, self._document.graph
        if viewpoint is None or graph is None:
            self.viewpoint, self.directions, self.neighbors = None, (), ()
        else:
            self.viewpoint, self.eye = viewpoint.id, np.array(viewpoint.position)
            arrays = self._document.graph_arrays
            self.directions = directions(graph, arrays, viewpoint.id, self.config)
            self.neighbors = tuple((id, arrays.feet[arrays.index[id]]) for id in graph.neighbors(viewpoint.id))
        if self.current is None:
            self._pointed = None
        self.changed.emit()

    @property
    def current(self) -> Direction | None:
        """The highlighted direction, None if there is none."""
        return next((d for d in self.directions if d.key == self._pointed), None)

    def point(self, direction: Direction | None) -> None:
        key = None if direction is None else direction.key
        if key != self._pointed:
            self._pointed = key
            self.pointed.emit()


_FINE = 14  # points per side of a region, because straight lines on the floor are curves in a panorama


def viewing_angles(points: NDArray[np.float64], eye: NDArray[np.float64], around: float = 0.0) -> NDArray[np.float64]:
    """(N, 2) heading and elevation in radians of world points (N, 3), seen from `eye` (3,); meters. The headings are
    within half a turn of `around`."""
    way = points - eye
    heading = np.arctan2(way[:, 0], way[:, 1])
    heading = (heading - around + math.pi) % (2 * math.pi) - math.pi + around
    return np.stack([heading, np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))], axis=1)


def densify_outline(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) points of the closed outline with the corners (N, 3), with added points on each side."""
    share = np.linspace(0, 1, _FINE, endpoint=False)[:, None]
    following = np.roll(corners, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, following, strict=True)])


def direction_hit(
    found: Sequence[Direction], eye: NDArray[np.float64], heading: float, elevation: float
) -> Direction | None:
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


class NeighborMarks:
    """The marks of the neighbors of the inspected viewpoint. `hovered` is the viewpoint id under the cursor."""

    def __init__(self, inspection: Inspection) -> None:
        self._inspection = inspection
        self._pixels = np.zeros((0, 2))  # (N, 2) of the visible marks, from the last painting
        self._ids: list[str] = []
        self.hovered: str | None = None

    def neighbor_under(self, point: QPointF) -> str | None:
        """The id of the neighbor whose mark is under `point`, None if there is none."""
        if not self._ids:
            return None
        distance = np.hypot(*(self._pixels - [point.x(), point.y()]).T)
        nearest = int(np.argmin(distance))
        return self._ids[nearest] if distance[nearest] <= _REACH else None

    def paint(self, painter: QPainter, middle: float, scale: float, height: int, heading: float, width: int) -> None:
        """Paints the marks in a view of `width` x `height` pixels, with `scale` pixels per radian. The center of the
        view is at `heading` and at elevation `middle`, in radians."""
        eye, found = self._inspection.eye, self._inspection.neighbors
        self._ids, places = [], []
        for id, foot in found:
            ((turn, elevation),) = viewing_angles(foot[None], eye, heading)
            x, y = width / 2 + (turn - heading) * scale, height / 2 - (elevation - middle) * scale
            if not (0 <= x <= width and 0 <= y <= height):
                continue
            self._ids.append(id)
            places.append((x, y))
            meters = math.dist(foot, eye)
            radius = min(max(_NEAR / max(meters, 0.1), _SIZE[0]), _SIZE[1]) * (1.3 if id == self.hovered else 1.0)
            painter.setPen(QPen(QColor("#20252b"), 3.6))
            painter.setBrush(QColor(colors.NODE))
            painter.drawEllipse(QPointF(x, y), radius, 0.5 * radius)
            painter.setPen(QPen(QColor("#ffffff"), 1.4))
            painter.drawEllipse(QPointF(x, y), radius, 0.5 * radius)
            if id == self.hovered:
                paint_label(
                    painter,
                    QPointF(x + 14, y + 5),
                    f"{self._inspection.name_of(id)}, {lengths.length(meters, 1)}",
                    QColor("#e8edf2"),
                    QColor("#20252b"),
                )
        self._pixels = np.array(places).reshape(-1, 2)
