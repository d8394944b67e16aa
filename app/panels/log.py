"""Everything that was said since the window opened."""

from __future__ import annotations

import time

from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.look import colors
from app.look.notices import Notice, Notices
from app.look.plain_text import lines, marked

_COLORS = {
    "log": colors.QUIET_TEXT,
    "info": colors.QUIET_TEXT,
    "warning": colors.WARNING_TEXT,
    "error": colors.BLOCKED_TEXT,
}
MOST_LINES = 5000
DETAIL = 50_000  # characters of a trace


class LogPanel(QPlainTextEdit):
    """Notices with their time; details below them."""

    def __init__(self, notices: Notices, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setFrameShape(self.Shape.NoFrame)
        self.setMaximumBlockCount(MOST_LINES)
        self.setPlaceholderText("Nothing to report.")
        notices.added.connect(self.append_notice)

    def append_notice(self, notice: Notice) -> None:
        clock = time.strftime("%H:%M:%S", time.localtime(notice.when))
        color = _COLORS[notice.severity]
        self.appendHtml(
            f'<span style="color:{color}">{clock}&nbsp;&nbsp;{notice.severity}</span>&nbsp;&nbsp;{marked(notice.text)}'
        )
        if notice.detail:
            self.appendPlainText(lines(notice.detail.rstrip(), DETAIL, DETAIL))
