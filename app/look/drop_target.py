"""A frame over the window while a file that can be dropped hovers over it."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QRectF, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from app.look.metrics import type_font

_WIDTH = 4.0  # pixels


class DropTarget(QWidget):
    """Covers `window` with a colored frame and a sentence, and ignores the mouse."""

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self.words = ""
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        window.installEventFilter(self)
        self.hide()

    def show_words(self, words: str) -> None:
        """Shows the frame with a sentence; "" hides it."""
        self.words = words
        self.setGeometry(0, 0, self.window().width(), self.window().height())
        self.setVisible(bool(words))
        self.raise_()
        self.update()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.isVisible():
            self.setGeometry(0, 0, self.window().width(), self.window().height())
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        accent = self.palette().accent().color()
        edge = _WIDTH / 2
        painter.setPen(QPen(accent, _WIDTH))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(edge, edge, -edge, -edge), 6, 6)
        painter.setFont(type_font("large"))
        box = painter.fontMetrics().boundingRect(self.rect(), Qt.AlignmentFlag.AlignCenter, self.words)
        box.adjust(-20, -12, 20, 12)
        painter.setBrush(self.palette().toolTipBase())
        painter.drawRoundedRect(box, 6, 6)
        painter.setPen(self.palette().toolTipText().color())
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, self.words)
