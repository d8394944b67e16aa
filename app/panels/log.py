"""The log of all messages since the window opened, and the messages of one job."""

from __future__ import annotations

import time
from collections import deque

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.forms.fields import command_line
from app.jobs.queue import JobHandle
from app.look import colors
from app.look.notices import Notice, Notices
from app.look.plain_text import lines, marked
from nvsim.files.opening import read_end

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


MOST_PRINTED = 4000  # characters of the end of the output
_KINDS = {
    "log": "quiet",
    "warning": "warning",
    "error": "blocked",
    "done": "open",
}


class JobLog(QPlainTextEdit):
    """Shows the command and the messages of a job. The command is first, so that it can be copied with the rest."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setAccessibleName("Messages of the job")
        self.setFrameShape(self.Shape.NoFrame)
        self.setPlaceholderText("Select a job to see its messages.")
        self._handle: JobHandle | None = None
        self._shown_lines = 0
        self._state = ""

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows the messages of this job; None shows nothing."""
        self._handle, self._shown_lines = handle, 0
        self.clear()
        if handle is not None:
            self._state = handle.state
            order = handle.job.order
            self.appendPlainText(lines(command_line(order.verb, order.arguments), MOST_PRINTED))
            self.refresh()
            self._append_printed()

    def changeEvent(self, event: QEvent) -> None:
        """Rewrites the messages in the colors of the new theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_state"):
            self.show_job(self._handle)

    def refresh(self) -> None:
        """Appends new messages."""
        handle = self._handle
        if handle is None:
            return
        new = handle.history.line_count - self._shown_lines
        if new > 0:
            self._shown_lines = handle.history.line_count
            for line in list(handle.history.lines)[-new:]:
                stamp = time.strftime("%H:%M:%S", time.localtime(line.at))
                ink = colors.text(_KINDS[line.kind])
                self.appendHtml(f'<span style="color:{ink}">{stamp}</span>&nbsp;&nbsp;{marked(line.text)}')
        if handle.state != self._state:
            self._state = handle.state
            self._append_printed()

    def _append_printed(self) -> None:
        """Appends the end of the output of a failed or interrupted job, usually a traceback."""
        handle = self._handle
        if handle is None or handle.state not in ("failed", "interrupted"):
            return
        said = [line.text for line in handle.history.lines if line.kind == "error"]
        if handle.message and not any(handle.message in text for text in said):
            ink = colors.text("blocked")
            self.appendHtml(f'<span style="color:{ink}">{marked(handle.message)}</span>')
        try:
            printed = read_end(handle.job.messages, MOST_PRINTED).decode(errors="replace").strip()
        except OSError:
            return
        news = [line for line in printed.splitlines() if not any(text.partition(": ")[2] in line for text in said)]
        if news:
            self.appendPlainText(lines("\n".join(news), MOST_PRINTED, MOST_PRINTED))
