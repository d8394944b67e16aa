"""The status bar of the window."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QStatusBar, QWidget

from app.look.metrics import GRID
from app.look.plain_text import tip

_DIRECT = Qt.FindChildOption.FindDirectChildrenOnly


class StatusLine(QStatusBar):
    """A status bar that elides a long message before the permanent widgets, and shows all of it as a tooltip."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.messageChanged.connect(lambda words: self.setToolTip(tip(words)))

    def paintEvent(self, event: QPaintEvent) -> None:
        words = self.currentMessage()
        if not words:
            super().paintEvent(event)
            return
        shown = [w for w in self.findChildren(QWidget, options=_DIRECT) if w.isVisible()]
        right = min([w.x() for w in shown if w.x() > GRID], default=self.width())
        painter = QPainter(self)
        painter.setPen(self.palette().windowText().color())
        box = self.rect().adjusted(GRID, 0, right - GRID - self.width(), 0)
        text = painter.fontMetrics().elidedText(words, Qt.TextElideMode.ElideRight, box.width())
        painter.drawText(box, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, text)
