"""The log: all messages since the window opened."""

from __future__ import annotations

import time
from collections import deque

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.look import colors
from app.look.notices import Notice, Notices
from app.look.plain_text import lines, marked

_COLORS = {
    "log": "quiet",
    "info": "quiet",
    "warning": "warning",
    "error": "blocked",
}
MOST_LINES = 5000
DETAIL = 50_000  # characters of a traceback


class LogPanel(QPlainTextEdit):
    """Shows notices with their times and details."""

    def __init__(self, notices: Notices, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setFrameShape(self.Shape.NoFrame)
        self.setMaximumBlockCount(MOST_LINES)
        self.setPlaceholderText("Nothing to report.")
        self._notices: deque[Notice] = deque(maxlen=MOST_LINES)
        notices.added.connect(self.append_notice)

    def changeEvent(self, event: QEvent) -> None:
        """Rewrites the log in the colors of the new theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_notices"):
            self.clear()
            for notice in self._notices:
                self._write(notice)

    def append_notice(self, notice: Notice) -> None:
        self._notices.append(notice)
        self._write(notice)

    def _write(self, notice: Notice) -> None:
        clock = time.strftime("%H:%M:%S", time.localtime(notice.when))
        color = colors.text(_COLORS[notice.severity])
        self.appendHtml(
            f'<span style="color:{color}">{clock}&nbsp;&nbsp;{notice.severity}</span>&nbsp;&nbsp;{marked(notice.text)}'
        )
        if notice.detail:
            self.appendPlainText(lines(notice.detail.rstrip(), DETAIL, DETAIL))
