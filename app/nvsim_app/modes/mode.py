"""The interface of an editing mode, and the functions that draw its marks over a view.

A mode uses only the GraphSurface interface of a view, so it works both in the map and in the 3D view.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QKeyEvent, QPainter, QPen, QPolygonF

from nvsim_app.look import colors
from nvsim_app.look.plain_text import SENTENCE, plain
from nvsim_app.painting.picking import NEAR
from nvsim_app.state.document import Document
from nvsim_app.state.editing import Editing
from nvsim_app.views.graph_surface import GraphSurface

_M = Qt.KeyboardModifier


@dataclass(frozen=True)
class Pointer:
    """The mouse pointer at one moment: the view, the position in its pixels, and the pressed modifier keys."""

    surface: GraphSurface
    point: QPointF
    modifiers: Qt.KeyboardModifier = _M.NoModifier

    @property
    def adds_to_selection(self) -> bool:
        return bool(self.modifiers & _M.ShiftModifier)

    @property
    def toggles_selection(self) -> bool:
        return bool(self.modifiers & _M.ControlModifier)

    @property
    def free(self) -> bool:
        """Whether snapping is off."""
        return bool(self.modifiers & _M.AltModifier)

    @property
    def viewpoint(self) -> str | None:
        return self.surface.pick_viewpoint(self.point)

    @property
    def edge(self) -> tuple[str, str] | None:
        return self.surface.pick_edge(self.point)


@dataclass(frozen=True)
class ModeContext:
    """The objects that every mode may use. `say` shows a text in the status bar; `refresh` repaints the views."""

    document: Document
    editing: Editing
    say: Callable[[str], None]
    refresh: Callable[[], None]


class Mode:
    """The base class. It handles nothing, so that the view handles the mouse itself."""

    name: ClassVar[str] = ""
    hint: ClassVar[str] = ""
    """The effect of the mouse, for the status bar."""
    cursor: ClassVar[Qt.CursorShape] = Qt.CursorShape.ArrowCursor
    needs_graph: ClassVar[bool] = True
    """Whether the mode needs a graph. If not, a trajectory is enough."""

    def __init__(self, context: ModeContext) -> None:
        self.context = context

    def enter(self) -> None:
        """Called when the mode becomes current."""

    def leave(self) -> None:
        """Called when another mode becomes current. Drops unfinished actions."""
        self.cancel()

    def cancel(self) -> bool:
        """Cancels the current action. Returns False if there is none."""
        return False

    def click(self, pointer: Pointer) -> bool:
        """Handles a left click. Returns False to leave it to the view."""
        return False

    def takes_drag(self, start: Pointer) -> bool:
        """Whether the mode handles a drag from there. If not, the drag moves the camera."""
        return False

    def drag(self, start: Pointer, now: Pointer) -> None:
        """Handles a move during an accepted drag."""

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        """Handles the end of an accepted drag."""

    def hover(self, pointer: Pointer) -> bool:
        """Handles a move without a button. Returns True to turn off the view's own hover effect."""
        return False

    def on_pointer_left(self) -> None:
        """Called when the pointer leaves the view. Removes the hints at the pointer."""

    def takes_key(self, event: QKeyEvent) -> bool:
        """Whether the mode handles a key that is also the shortcut of a command."""
        return False

    def key(self, event: QKeyEvent) -> bool:
        """Handles a key press in a view. Returns whether the key was used."""
        return False

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        """Draws the current action, in the pixels of `surface`."""


GHOST = colors.SELECTED
_LABEL = QColor(16, 20, 26, 225)
_WRAPPED = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter | Qt.TextFlag.TextWordWrap
_WIDEST = 280.0  # pixels; a longer label has several lines


def label(painter: QPainter, anchor: QPointF, text: str, ink: str = "#f2f5f8") -> None:
    """Draws a small label beside `anchor` (pixels), inside the view. A long text wraps."""
    text = plain(text, SENTENCE)
    box = label_box(painter, anchor, text)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(_LABEL)
    painter.drawRoundedRect(box, 4, 4)
    painter.setPen(QColor(ink))
    painter.drawText(box.adjusted(6, 2, -6, -2), _WRAPPED, text)


def label_box(painter: QPainter, anchor: QPointF, text: str) -> QRectF:
    """The rectangle of `label` in pixels."""
    picture = painter.viewport()
    room = QRectF(0, 0, min(_WIDEST, max(40.0, picture.width() - 20.0)), 10_000)
    words = painter.boundingRect(room, _WRAPPED, text)
    width, height = words.width() + 13, words.height() + 4
    x = min(max(anchor.x() + 12, 4.0), max(4.0, picture.width() - width - 4))
    y = anchor.y() - 14 - painter.fontMetrics().height()  # several lines grow downward, away from a label above
    return QRectF(x, max(4.0, min(y, picture.height() - 4 - height)), width, height)


def line(
    painter: QPainter,
    surface: GraphSurface,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    color: str = GHOST,
    width: float = 2.2,
    style: Qt.PenStyle = Qt.PenStyle.DashLine,
) -> None:
    """Draws lines between world positions `a` and `b` in meters, each (N, 3) or (3,)."""
    lines, _, _ = surface.segments(np.atleast_2d(a), np.atleast_2d(b))
    pen = QPen(QColor(color), width, style)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    painter.setPen(pen)
    for x1, y1, x2, y2 in lines:
        painter.drawLine(QPointF(x1, y1), QPointF(x2, y2))


def dots(
    painter: QPainter,
    surface: GraphSurface,
    places: NDArray[np.float64],
    color: str = GHOST,
    radius: float = 6.0,
    filled: bool = True,
) -> None:
    """Draws discs, or rings if not `filled`, at world positions (N, 3) or (3,) in meters. `radius` is in pixels."""
    if not len(places):
        return
    pixels, depths = surface.project(np.atleast_2d(places))
    painter.setPen(QPen(QColor("#1d1502" if filled else color), 1.4 if filled else 2.4))
    painter.setBrush(QColor(color) if filled else Qt.BrushStyle.NoBrush)
    for (x, y), depth in zip(pixels, depths, strict=True):
        if depth > NEAR:
            painter.drawEllipse(QPointF(x, y), radius, radius)


def area(painter: QPainter, shape: QRectF | QPolygonF) -> None:
    """Draws a selection area, a rectangle or polygon in pixels."""
    fill = QColor(colors.SELECTED)
    fill.setAlpha(38)
    painter.setPen(QPen(QColor(colors.SELECTED), 1.4, Qt.PenStyle.DashLine))
    painter.setBrush(fill)
    if isinstance(shape, QRectF):
        painter.drawRect(shape)
    else:
        painter.drawPolygon(shape)
