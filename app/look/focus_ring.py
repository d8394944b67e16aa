"""A ring around the view, list, or plot with the keyboard focus, because these widgets do not show the focus
themselves."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QRect, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QRegion
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QMainWindow,
    QMenuBar,
    QTabBar,
    QWidget,
)
from shiboken6 import isValid

from app.look.labels import Label

_WIDTH = 2  # pixels
_OWN = (
    QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, Label, QLineEdit, QMenuBar, QTabBar
)  # fmt: skip
"""Widgets whose focus the style draws."""


class FocusRing(QWidget):
    """An overlay of `window` that ignores the mouse and covers only the border of the focused widget."""

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.setObjectName("focusRing")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.around: QWidget | None = None
        self.hide()
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        app.focusChanged.connect(self._on_focus)

    def _on_focus(self, _: QWidget | None, now: QWidget | None) -> None:
        if self.around is not None and isValid(self.around):
            self.around.removeEventFilter(self)
            self.around.destroyed.disconnect(self._forget)
        self.around = now if now is not None and now.window() is self.window() and not isinstance(now, _OWN) else None
        if self.around is not None:
            self.around.installEventFilter(self)
            self.around.destroyed.connect(self._forget)
        self._place()

    def _forget(self) -> None:
        self.around = None
        self.hide()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Move, QEvent.Type.Show, QEvent.Type.Hide):
            self._place()
        return False

    def _place(self) -> None:
        widget = self.around
        if widget is None or not widget.isVisible():
            self.hide()
            return
        seen, above = QRect(widget.mapTo(self.window(), widget.rect().topLeft()), widget.size()), widget.parentWidget()
        while above is not None and above is not self.window():  # a scroll area may show only a part
            seen &= QRect(above.mapTo(self.window(), above.rect().topLeft()), above.size())
            above = above.parentWidget()
        self.setGeometry(seen)
        inner = self.rect().adjusted(_WIDTH, _WIDTH, -_WIDTH, -_WIDTH)
        self.setMask(QRegion(self.rect()) - QRegion(inner))
        self.show()
        self.raise_()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), self.palette().link())
        painter.end()
