"""Parts of the map: the graph, the camera of the 3D view, and the widgets at its border.

All edges and viewpoints are painted in a few painter calls, in screen pixels. The curve and scatter items of pyqtgraph
stroke a path and sort their points. For forty thousand edges and ten thousand viewpoints, that takes twice as long.
"""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QAction, QColor, QPainter, QPainterPath, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsSceneMouseEvent, QStyleOptionGraphicsItem, QToolButton, QWidget

from nvsim_app.look import colors, lengths
from nvsim_app.look.labels import Label
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.painting.graph_ink import LARGE, DrawingCache, GraphInk
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays, column_bounds


class CameraMarker(pg.GraphicsObject):
    """Marks the camera of the 3D view with a dot and a wedge for its direction, at a constant size in pixels. Dragging
    the dot moves the camera.

    dragged(float x, float y): the new position in meters, world.
    """

    dragged = Signal(float, float)

    def __init__(self) -> None:
        super().__init__()
        self.setFlag(self.GraphicsItemFlag.ItemIgnoresTransformations)
        self.setZValue(50)
        self.setCursor(Qt.CursorShape.SizeAllCursor)
        self.setToolTip("The camera of the 3D view; drag it to move")
        self._wedge = math.radians(70)
        self._heading = 0.0

    def show_pose(self, pose: ViewPose) -> None:
        x, y, _ = pose.position
        self.setPos(x, y)
        self._heading = pose.heading
        self.update()

    def boundingRect(self) -> QRectF:
        return QRectF(-34, -34, 68, 68)

    def shape(self) -> QPainterPath:
        path = QPainterPath()
        path.addEllipse(QPointF(0, 0), 9, 9)
        return path

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        # On the screen y points down, so heading 0 (north) is up and headings turn clockwise.
        painter.rotate(math.degrees(self._heading))
        fill = QColor(colors.CAMERA)
        fill.setAlpha(70)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(fill)
        degrees = math.degrees(self._wedge)
        painter.drawPie(QRectF(-32, -32, 64, 64), round(16 * (90 - degrees / 2)), round(16 * degrees))
        painter.setPen(QPen(QColor("#ffffff"), 1.5))
        painter.setBrush(QColor(colors.CAMERA))
        painter.drawEllipse(QPointF(0, 0), 5.5, 5.5)

    def mousePressEvent(self, event: QGraphicsSceneMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            event.accept()
        else:
            event.ignore()

    def mouseMoveEvent(self, event: QGraphicsSceneMouseEvent) -> None:
        place = self.mapToParent(event.pos())
        self.dragged.emit(place.x(), place.y())


_EDGE = 8  # pixels from the corners of the map


class North(QWidget):
    """The north arrow, which always points up because the map is never rotated."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent, toolTip="North: +y of the project's frame is up", accessibleName="North is up")
        self.setFixedSize(18, 30)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ink = self.palette().text().color()
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(ink)
        painter.drawPolygon(QPolygonF([QPointF(9, 0), QPointF(15, 14), QPointF(9, 10), QPointF(3, 14)]))
        painter.setPen(ink)
        painter.drawText(self.rect().adjusted(0, 14, 0, 0), Qt.AlignmentFlag.AlignCenter, "N")


class MapFrame:
    """The title, the button, the arrow, and the coordinates over a map. `place` moves them to its corners."""

    def __init__(self, map_view: QWidget) -> None:
        self._view = map_view
        self._title: QWidget | None = None
        self.north = North(map_view)
        self.whole = QToolButton(map_view)
        self.whole.setAutoRaise(True)
        self.whole.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.coordinates = Label(map_view)
        self.coordinates.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.coordinates.setAutoFillBackground(True)
        self.coordinates.setMargin(4)
        self.coordinates.hide()
        self.show(False)

    def set_action(self, action: QAction) -> None:
        """Sets the action of the button."""
        self.whole.setDefaultAction(action)
        self.place()

    def set_title(self, title: QWidget) -> None:
        """Sets the widget at the top left, which is as wide as its content if there is room."""
        title.setParent(self._view)
        self._title = title
        self.place()

    @property
    def titled(self) -> bool:
        """Whether the widget at the top left is visible."""
        return self._title is not None and not self._title.isHidden()

    def show(self, on: bool) -> None:
        """Shows or hides the arrow and the button, which need a map."""
        self.north.setVisible(on)
        self.whole.setVisible(on)

    def show_position(self, place: tuple[float, float] | None) -> None:
        """Shows the position (x, y) under the cursor in meters; None hides it."""
        self.coordinates.setVisible(place is not None)
        if place is not None:
            self.coordinates.setText(lengths.position_text(*place))
            self.place()

    def place(self, _: QEvent | None = None) -> None:
        """Moves the widgets to the corners of the map."""
        width, height = self._view.width(), self._view.height()
        self.whole.adjustSize()
        self.whole.move(width - self.whole.width() - _EDGE, _EDGE)
        self.north.move(self.whole.x() - self.north.width() - 4, _EDGE)
        if self._title is not None:
            wide = min(self._title.sizeHint().width(), self.north.x() - 2 * _EDGE)
            self._title.setGeometry(_EDGE, _EDGE, wide, self._title.sizeHint().height())
        self.coordinates.adjustSize()
        self.coordinates.move(_EDGE, height - self.coordinates.height() - _EDGE)
        for widget in (self.north, self.whole, self.coordinates):
            widget.raise_()


_RADIUS = 4.0  # maximum radius of a disc, pixels; smaller if viewpoints are dense
_LEAST = 1.5
_MARGIN = 6  # pixels outside the widget within which a disc may reach into it

_Lines = tuple[NDArray[np.float64], NDArray[np.int64]]  # edges in view (M, 4) pixels, rows of viewpoints in view (K,)


class GraphItem(pg.GraphicsObject):
    """The graph on the map. `hovered` is the viewpoint id under the cursor of either view; call `update` after setting
    it."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._ink = GraphInk()
        self._kept = DrawingCache(self, self.update)
        self._latest: tuple[GraphArrays, tuple[float, ...], _Lines] | None = None  # graph, transform, and visible parts
        self._bounds = QRectF()
        self._spacing = 1.0  # approximate distance between viewpoints, meters
        self.hovered: str | None = None
        self.radius = _RADIUS  # radius of a disc in the last painting, pixels
        self.setZValue(20)

    def refresh(self) -> None:
        """Updates bounds and sizes. Call it after the graph of the document changed."""
        positions = self._document.graph_arrays.positions
        bounds = QRectF()
        if len(positions):
            low, high = column_bounds(positions[:, :2])
            low, high = low - 1, high + 1
            bounds = QRectF(*low, *(high - low))
            spacing = (float(np.prod(high - low)) / len(positions)) ** 0.5
            if not 0.9 < spacing / self._spacing < 1.1:  # an edit must not change the size of every disc
                self._spacing = spacing
        if bounds != self._bounds:
            self.prepareGeometryChange()
            self._bounds = bounds
        self.update()

    def boundingRect(self) -> QRectF:
        return self._bounds

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        arrays = self._document.shown_arrays
        if not arrays.ids or widget is None:
            return
        origin, axes = self._transform(painter)
        pixels = arrays.positions[:, :2] @ axes + origin
        scale = float(np.linalg.norm(axes[0]))  # pixels per meter
        radius = self.radius = float(np.clip(0.3 * self._spacing * scale, _LEAST, _RADIUS))
        width, height = widget.width(), widget.height()
        painter.save()
        painter.resetTransform()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if len(arrays.edges) > LARGE:
            place = (*origin, *axes.ravel(), width, height)
            if self._latest is None or self._latest[0] is not arrays or self._latest[1] != place:
                self._latest = arrays, place, self._visible_elements(arrays, pixels, (width, height))
            seen = self._latest[2]
            manner = self._ink.paint_styles(len(seen[0]), arrays.included[seen[1]])

            def draw(target: QPainter, within: QRectF | None) -> None:
                self._draw(target, arrays, pixels, radius, seen, within)

            def changed_area(drawn: object) -> QRectF | None:
                return _outline(
                    self._document.graph_changes.changed_segments_since(drawn), origin, axes, (width, height)
                )

            view = (radius, place, manner, self._document.storeys.height_range)
            self._kept.paint(painter, width, height, view, draw, self._document.graph_arrays, changed_area)
        else:
            self._draw(painter, arrays, pixels, radius, self._visible_elements(arrays, pixels, (width, height)))
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self.hovered or "")
        for row in (hovered, selected):
            if row is not None:
                self._ink.draw_marked(painter, pixels[row], np.full(2, max(radius, 4.0)), row == selected)
        painter.restore()

    def _draw(
        self,
        painter: QPainter,
        arrays: GraphArrays,
        pixels: NDArray[np.float64],
        radius: float,
        seen: _Lines,
        within: QRectF | None = None,
    ) -> None:
        lines, rows = seen
        self._ink.draw_edges(painter, lines, within=within)
        self._ink.draw_viewpoints(painter, pixels[rows], np.full((len(rows), 2), radius), arrays.included[rows], within)

    def _visible_elements(self, arrays: GraphArrays, pixels: NDArray[np.float64], size: tuple[int, int]) -> _Lines:
        """The edges and the viewpoints that may be visible."""
        (width, height), (x, y) = size, pixels.T
        # Bits for the sides of the widget that an end is beyond. An edge with both ends beyond one side is invisible.
        beyond = (1 * (x < 0) + 2 * (x > width) + 4 * (y < 0) + 8 * (y > height)).astype(np.uint8)
        a, b = arrays.edges.T
        rows = np.flatnonzero((beyond[a] & beyond[b]) == 0)
        if len(rows) < len(a):
            a, b = a[rows], b[rows]
        lines = np.empty((len(a), 4))
        for column, values in enumerate((x[a], y[a], x[b], y[b])):
            lines[:, column] = values
        near = (x > -_MARGIN) & (x < width + _MARGIN) & (y > -_MARGIN) & (y < height + _MARGIN)
        return lines, np.flatnonzero(near)

    def _transform(self, painter: QPainter) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(2,) logical pixel of the world origin, and (2, 2) pixels per meter along x and along y."""
        zero, right, up = (painter.transform().map(QPointF(x, y)) for x, y in ((0, 0), (1, 0), (0, 1)))
        origin = np.array([zero.x(), zero.y()])
        return origin, np.array([[right.x(), right.y()], [up.x(), up.y()]]) - origin


def _outline(
    places: NDArray[np.float64] | None, origin: NDArray[np.float64], axes: NDArray[np.float64], size: tuple[int, int]
) -> QRectF | None:
    """The pixels that edges and viewpoints at `places` (K, 2, 3) may cover; None for the whole map."""
    if places is None:
        return None
    if not len(places):
        return QRectF()
    pixels = places.reshape(-1, 3)[:, :2] @ axes + origin
    low = np.clip(pixels.min(axis=0) - _MARGIN - 1, -1, size)
    high = np.clip(pixels.max(axis=0) + _MARGIN + 1, 0, np.add(size, 1))
    return QRectF(*low.tolist(), *(high - low).tolist())
