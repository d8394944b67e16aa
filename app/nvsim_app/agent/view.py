"""The agent's image, scaled to the widget, with clickable marks of the navigable locations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from nvsim.geometry.directions import HEIGHT, WIDTH
from nvsim_app.agent.agent_walk import AgentWalk
from nvsim_app.agent.state import AgentState
from nvsim_app.look import colors, lengths
from nvsim_app.look.plain_text import lines, tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.painting.picking import NEAR
from nvsim_app.painting.primitives import chip_box, paint_label
from nvsim_app.state.document import Document

MARGIN = 16.0  # pixels from the image border to the center of a mark, so that the whole mark is visible
_APART = 24.0  # pixels between two marks
_WITHIN = 0.5  # pixels from the image border; if the agent looks up or down, level locations are on the border


@dataclass(frozen=True)
class LocationMark:
    """The mark of one navigable location.

    index     index in navigableLocations
    x, y      pixels of the 640 x 480 image: the viewpoint's camera, moved to the border if it is outside the image
    inside    whether the viewpoint's camera is in the image
    foot      pixels of the point on the floor below it; None if `inside` is false or the point is behind the camera
    distance  meters
    """

    index: int
    viewpoint: str
    x: float
    y: float
    inside: bool
    foot: tuple[float, float] | None
    distance: float


def marks(state: AgentState, feet: Mapping[str, NDArray[np.float64]]) -> tuple[LocationMark, ...]:
    """The marks of all navigable locations except the first, farthest first, so that near marks are drawn on top.
    `feet` maps viewpoint ids to floor points (3,) in meters, world."""
    placed: list[LocationMark] = []
    for mark in sorted(_marks(state, feet), key=lambda mark: mark.distance):
        up = -1 if mark.y >= HEIGHT / 3 else 1
        while any(abs(mark.x - other.x) < _APART and abs(mark.y - other.y) < _APART for other in placed):
            mark = replace(mark, y=mark.y + up * _APART)
        placed.append(mark)
    return tuple(reversed(placed))


def _marks(state: AgentState, feet: Mapping[str, NDArray[np.float64]]) -> Iterator[LocationMark]:
    camera = state.camera
    for index, place in enumerate(state.navigableLocations[1:], 1):
        eye = np.array([place.x, place.y, place.z])
        pixels, depths = camera.project(np.stack([eye, feet.get(place.viewpointId, eye)]))
        (x, y), foot = pixels[0].tolist(), pixels[1].tolist()
        ahead = bool(depths[0] > NEAR)
        inside = ahead and _WITHIN <= x <= WIDTH - _WITHIN and _WITHIN <= y <= HEIGHT - _WITHIN
        if not ahead:  # beside or behind the agent: at the side to which the agent must turn
            x, y = (WIDTH if place.rel_heading > 0 else 0.0), HEIGHT / 2
        yield LocationMark(
            index,
            place.viewpointId,
            min(max(x, MARGIN), WIDTH - MARGIN),
            min(max(y, MARGIN), HEIGHT - MARGIN),
            inside,
            (foot[0], foot[1]) if inside and depths[1] > NEAR else None,
            place.rel_distance,
        )


RADIUS = 13.0  # radius of a mark, pixels
_REACH = 18.0  # radius around a mark that accepts a click, pixels
_PATIENCE = 150  # milliseconds for which the previous image and its marks stay while the next image is rendered
_GROUND, _INK, _LABEL = QColor("#181a1f"), QColor("#e8edf2"), QColor(16, 20, 26, 200)
KEYS = "← → turn 30° · ↑ ↓ look up, down · 1–9 move · Backspace undo · Home start · Esc stop"


class AgentView(QWidget):
    """Shows the agent's image and its marks.

    taken(str)       the user clicked the mark of the navigable location with this viewpoint id
    pointedAt(int)   the index of the location under the cursor, -1 for none
    """

    taken = Signal(str)
    pointedAt = Signal(int)

    def __init__(self, document: Document, walk: AgentWalk) -> None:
        super().__init__(accessibleName="View of the agent", focusPolicy=Qt.FocusPolicy.StrongFocus, mouseTracking=True)
        self.setObjectName("agentView")
        self.setMinimumSize(WIDTH // 2, HEIGHT // 3)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self._document, self._walk = document, walk
        self.shown: AgentState | None = None
        """The state whose marks are drawn."""
        self.marks: tuple[LocationMark, ...] = ()
        self._refusal = ""
        self.pointed = -1  # index of the mark under the cursor, or of the row in the panel
        self._image: QImage | None = None
        self._image_of: AgentState | None = None
        self._late = QTimer(self, singleShot=True, interval=_PATIENCE)
        self._late.timeout.connect(self._show_state)
        walk.changed.connect(self._on_changed)
        walk.pictured.connect(self._on_pictured)
        walk.refused.connect(self._on_refused)

    def sizeHint(self) -> QSize:
        return QSize(WIDTH, HEIGHT)

    def point(self, index: int) -> None:
        """Highlights the mark of a navigable location; -1 highlights none."""
        if index != self.pointed:
            self.pointed = index
            self.update()

    # Following the walk -------------------------------------------------------------------------------------------

    def _on_refused(self, sentence: str) -> None:
        self._refusal = sentence
        self.update()

    def _on_changed(self) -> None:
        state, self._refusal = self._walk.state, ""
        if state is None:
            self._image = self._image_of = None
            self._late.stop()
        if state is None or self._image_of is None or not self._walk.drawing:
            self._show_state()
        elif not self._late.isActive():
            self._late.start()

    def _on_pictured(self) -> None:
        pixels = self._walk.pixels
        self._image, self._image_of = None, None
        if pixels is not None:
            # QImage does not own the pixels of the array, so it is copied.
            self._image = QImage(pixels.data, WIDTH, HEIGHT, 3 * WIDTH, QImage.Format.Format_BGR888).copy()
            self._image_of = self._walk.state
        self._show_state()

    def _show_state(self) -> None:
        self._late.stop()
        self.shown = self._walk.state
        arrays = self._document.graph_arrays
        places = () if self.shown is None else self.shown.navigableLocations
        feet = {
            p.viewpointId: arrays.feet[arrays.index[p.viewpointId]] for p in places if p.viewpointId in arrays.index
        }
        self.marks = () if self.shown is None else marks(self.shown, feet)
        self.pointed = -1
        self.update()

    # Geometry -----------------------------------------------------------------------------------------------------

    @property
    def box(self) -> QRectF:
        """The rectangle of the image in the widget, pixels."""
        scale = min(self.width() / WIDTH, self.height() / HEIGHT)
        width, height = WIDTH * scale, HEIGHT * scale
        return QRectF((self.width() - width) / 2, (self.height() - height) / 2, width, height)

    def spot(self, mark: LocationMark) -> QPointF:
        """The position of a mark in the widget, pixels."""
        return self._to_widget(mark.x, mark.y)

    def _to_widget(self, x: float, y: float) -> QPointF:
        box = self.box
        return QPointF(box.x() + x * box.width() / WIDTH, box.y() + y * box.height() / HEIGHT)

    def location_under(self, point: QPointF) -> int:
        """The index of the location whose mark is nearest to `point` and within reach, -1 for none."""
        reached = [(_distance(self.spot(mark), point), mark.index) for mark in self.marks]
        near = [found for found in reached if found[0] <= _REACH]
        return min(near)[1] if near else -1

    # Painting -----------------------------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.fillRect(self.rect(), _GROUND)
        box = self.box
        if self._image is not None:
            painter.drawImage(box, self._image)
            if self._image_of is not self.shown:
                painter.fillRect(box, QColor(24, 26, 31, 190))
        self._paint_words(painter, box)
        if self.shown is not None:
            painter.save()
            painter.setClipRect(box)
            self._paint_marks(painter)
            painter.restore()
            self._paint_angles(painter, self.shown, box)
        painter.end()

    def _paint_marks(self, painter: QPainter) -> None:
        painter.setFont(type_font(bold=True))
        taken: list[QRectF] = []
        for mark in (m for m in self.marks if m.foot is not None):
            self._paint_foot(painter, mark)
        # Near marks are drawn last, on top. Near labels are placed first; labels without enough space are omitted.
        for mark in self.marks:
            self._paint_disc(painter, mark)
        for mark in reversed(self.marks):
            away = lengths.length(mark.distance, 1)
            spot = self.spot(mark)
            anchor = QPointF(spot.x() + RADIUS + 3, spot.y() + 9)
            where = chip_box(painter, anchor, away)
            if where.right() > self.box.right():
                anchor.setX(spot.x() - RADIUS - 3 - where.width())
            where = chip_box(painter, anchor, away)
            if not any(where.intersects(other) for other in taken) or mark.index == self.pointed:
                taken.append(paint_label(painter, anchor, away, _INK, _LABEL))

    def _paint_foot(self, painter: QPainter, mark: LocationMark) -> None:
        assert mark.foot is not None
        spot, foot = self.spot(mark), self._to_widget(*mark.foot)
        painter.setPen(QPen(QColor(0, 0, 0, 120), 3.4))
        painter.drawLine(spot, foot)
        painter.setPen(QPen(QColor(colors.AGENT), 1.8))
        painter.drawLine(spot, foot)
        painter.setBrush(QColor(colors.AGENT))
        wide = max(4.0, 26.0 / max(mark.distance, 1.0))
        painter.drawEllipse(foot, wide, 0.4 * wide)

    def _paint_disc(self, painter: QPainter, mark: LocationMark) -> None:
        spot, pointed = self.spot(mark), mark.index == self.pointed
        radius = RADIUS * (1.25 if pointed else 1.0)
        painter.setPen(QPen(QColor(colors.SELECTED if pointed else "#ffffff"), 2.0))
        painter.setBrush(QColor(colors.AGENT))
        if mark.inside:
            painter.drawEllipse(spot, radius, radius)
        else:
            painter.drawRoundedRect(QRectF(spot.x() - radius, spot.y() - radius, 2 * radius, 2 * radius), 4, 4)
        painter.setPen(QColor("#ffffff"))
        around = QRectF(spot.x() - 20, spot.y() - 20, 40, 40)
        painter.drawText(around, Qt.AlignmentFlag.AlignCenter, str(mark.index))

    def _paint_angles(self, painter: QPainter, state: AgentState, box: QRectF) -> None:
        degrees = round(math.degrees(state.heading)), round(math.degrees(state.elevation))
        words = f"heading {degrees[0]}°, elevation {degrees[1]:+d}°, view {state.viewIndex}, step {state.step}"
        paint_label(painter, QPointF(box.x() + 8, box.y() + 30), words, _INK, _LABEL)
        if len(state.navigableLocations) == 1:
            words = "no navigable location in view" if self._walk.restricted else "no navigable location from here"
            paint_label(painter, QPointF(box.x() + 8, box.y() + 56), words, _INK, _LABEL)
        painter.setFont(type_font("small"))
        if self._refusal:
            ink = QColor(colors.SELECTED)
            width = chip_box(painter, QPointF(), self._refusal).width()
            paint_label(painter, QPointF(box.center().x() - width / 2, box.bottom() - 36), self._refusal, ink, _LABEL)
        if painter.fontMetrics().horizontalAdvance(KEYS) + 28 < box.width():
            paint_label(painter, QPointF(box.x() + 8, box.bottom() - 8), KEYS, _INK, _LABEL)

    def _paint_words(self, painter: QPainter, box: QRectF) -> None:
        walk = self._walk
        if walk.no_image:
            words = f"No image: {walk.no_image}"
        elif walk.state is None:
            words = "Starting the simulator…"
        elif walk.drawing and (self._image is None or self._image_of is not self.shown):
            words = "Drawing…"
        else:
            return
        painter.setPen(QColor("#9aa5b1"))
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop | Qt.TextFlag.TextWordWrap
        painter.drawText(box.adjusted(40, 0.18 * box.height(), -40, 0), flags, lines(words))

    # Mouse --------------------------------------------------------------------------------------------------------

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        index = self.location_under(event.position())
        if index != self.pointed:
            self.point(index)
            self.pointedAt.emit(index)
        self.setCursor(Qt.CursorShape.PointingHandCursor if index > 0 else Qt.CursorShape.ArrowCursor)
        self.setToolTip(tooltip_text(f"Click to go to {self._viewpoint(index)}") if index > 0 else "")

    def _viewpoint(self, index: int) -> str:
        return next((mark.viewpoint for mark in self.marks if mark.index == index), "")

    def leaveEvent(self, event: QEvent) -> None:
        self.point(-1)
        self.pointedAt.emit(-1)
        super().leaveEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        index = self.location_under(event.position())
        if event.button() == Qt.MouseButton.LeftButton and index > 0:
            self.taken.emit(self._viewpoint(index))


def _distance(one: QPointF, other: QPointF) -> float:
    return float(np.hypot(one.x() - other.x(), one.y() - other.y()))
