"""The demo room and simulated edits in it, shared by the tests of editing."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from nvsim_app.state.document import Document
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.wiring.window import MainWindow

LEFT = Qt.MouseButton.LeftButton
NONE = Qt.KeyboardModifier.NoModifier
SHIFT = Qt.KeyboardModifier.ShiftModifier
CTRL = Qt.KeyboardModifier.ControlModifier
ALT = Qt.KeyboardModifier.AltModifier


class Hand:
    """Works in one view of a window: places are meters, world."""

    def __init__(self, window: MainWindow, surface: GraphSurface) -> None:
        self.window, self.surface = window, surface
        self.document: Document = window.document

    def pixel(self, place: np.ndarray | tuple[float, ...]) -> QPoint:
        pixels, _ = self.surface.project(np.array(place, float)[None])
        return QPointF(*pixels[0]).toPoint()

    def foot(self, row: int) -> np.ndarray:
        return self.document.graph_arrays.feet[row]

    def click(self, place: np.ndarray | tuple[float, ...], keys: Qt.KeyboardModifier = NONE) -> None:
        QTest.mouseMove(self.surface.widget, self.pixel(place))
        QTest.mouseClick(self.surface.widget, LEFT, keys, self.pixel(place))
        QApplication.processEvents()

    def drag(self, *places: np.ndarray | tuple[float, ...], keys: Qt.KeyboardModifier = NONE) -> None:
        widget, last = self.surface.widget, self.pixel(places[0])
        QTest.mousePress(widget, LEFT, keys, last)
        for place in places[1:]:
            # QTest.mouseMove knows neither buttons nor keys.
            self._move(last + (self.pixel(place) - last) / 2, keys)
            last = self.pixel(place)
            self._move(last, keys)
        QTest.mouseRelease(widget, LEFT, keys, self.pixel(places[-1]))
        QApplication.processEvents()

    def hover(self, place: np.ndarray | tuple[float, ...], keys: Qt.KeyboardModifier = NONE) -> None:
        self._move(self.pixel(place), keys, Qt.MouseButton.NoButton)

    def _move(self, point: QPoint, keys: Qt.KeyboardModifier, buttons: Qt.MouseButton = LEFT) -> None:
        from PySide6.QtCore import QEvent
        from PySide6.QtGui import QMouseEvent

        widget = self.surface.widget
        event = QMouseEvent(
            QEvent.Type.MouseMove, QPointF(point), QPointF(widget.mapToGlobal(point)), Qt.MouseButton.NoButton, buttons,
            keys,
        )  # fmt: skip
        QApplication.sendEvent(widget, event)

    def key(self, key: Qt.Key, keys: Qt.KeyboardModifier = NONE) -> None:
        QTest.keyClick(self.surface.widget, key, keys)
        QApplication.processEvents()
