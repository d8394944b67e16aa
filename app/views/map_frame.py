"""The widgets at the border of the map: the button that shows everything, the north arrow, and the coordinates under
the cursor."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QAction, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QToolButton, QWidget

from app.look import lengths
from app.look.labels import Label

_EDGE = 8  # pixels from the corners of the map


class North(QWidget):
    """The north arrow, which always points up because the map is never rotated."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setFixedSize(18, 30)
        self.setToolTip("North: +y of the project's frame is up")
        self.setAccessibleName("North is up")

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
    """The button, the arrow, and the coordinates over a map. `place` moves them to its corners."""

    def __init__(self, map_view: QWidget) -> None:
        self._view = map_view
        self.north = North(map_view)
        self.whole = QToolButton(map_view)
        self.whole.setAutoRaise(True)
        self.whole.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.coordinates = Label(map_view)
        self.coordinates.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.coordinates.setAutoFillBackground(True)
        self.coordinates.setMargin(3)
        self.coordinates.hide()
        self.show(False)

    def take(self, action: QAction) -> None:
        """Sets the action of the button."""
        self.whole.setDefaultAction(action)
        self.place()

    def show(self, on: bool) -> None:
        """Shows or hides the arrow and the button, which need a map."""
        self.north.setVisible(on)
        self.whole.setVisible(on)

    def say(self, place: tuple[float, float] | None) -> None:
        """Shows the position (x, y) under the cursor in meters; None hides it."""
        self.coordinates.setVisible(place is not None)
        if place is not None:
            self.coordinates.setText(lengths.place(*place))
            self.place()

    def place(self, _: QEvent | None = None) -> None:
        """Moves the widgets to the corners of the map."""
        width, height = self._view.width(), self._view.height()
        self.whole.adjustSize()
        self.whole.move(width - self.whole.width() - _EDGE, _EDGE)
        self.north.move(self.whole.x() - self.north.width() - 4, _EDGE)
        self.coordinates.adjustSize()
        self.coordinates.move(_EDGE, height - self.coordinates.height() - _EDGE)
        for widget in (self.north, self.whole, self.coordinates):
            widget.raise_()
