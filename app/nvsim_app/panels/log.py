"""The log of all messages since the window opened, and the messages of one job."""

from __future__ import annotations

import time
from collections import deque

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from nvsim.files.opening import read_end
from nvsim_app.forms.fields import command_line
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look import colors
from nvsim_app.look.notices import Notice, Notices
from nvsim_app.look.plain_text import escape_html, lines

MOST_LINES = 5000
DETAIL = 50_000  # characters of a traceback
MOST_PRINTED = 4000  # characters of the end of the output
_COLORS = {"log": "quiet", "info": "quiet", "warning": "warning", "error": "blocked", "done": "open"}
"""Kind of a message -> meaning of its color."""


class _Log(QPlainTextEdit):
    """Lines of text with their times. Subclasses write them again in `rewrite`, after a change of the theme."""

    def __init__(self, empty: str, parent: QWidget | None = None) -> None:
        super().__init__(parent, readOnly=True, placeholderText=empty)
        self.setFrameShape(self.Shape.NoFrame)

    def rewrite(self) -> None:
        raise NotImplementedError

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and self.document().characterCount() > 1:
            self.rewrite()

    def _write(self, kind: str, when: float, text: str, name: str = "") -> None:
        """Appends a message; `name` of the kind is shown in its color, beside the time."""
        clock, color = time.strftime("%H:%M:%S", time.localtime(when)), colors.text(_COLORS[kind])
        head = f"{clock}&nbsp;&nbsp;{escape_html(name)}" if name else clock
        self.appendHtml(f'<span style="color:{color}">{head}</span>&nbsp;&nbsp;{escape_html(text)}')


class LogPanel(_Log):
    """Shows notices with their times and details."""

    def __init__(self, notices: Notices) -> None:
        super().__init__("Nothing to report.")
        self.setMaximumBlockCount(MOST_LINES)
        self._notices: deque[Notice] = deque(maxlen=MOST_LINES)
        notices.added.connect(self.append_notice)

    def rewrite(self) -> None:
        self.clear()
        for notice in self._notices:
            self._write_notice(notice)

    def append_notice(self, notice: Notice) -> None:
        self._notices.append(notice)
        self._write_notice(notice)

    def _write_notice(self, notice: Notice) -> None:
        self._write(notice.severity, notice.when, notice.text, notice.severity)
        if notice.detail:
            self.appendPlainText(lines(notice.detail.rstrip(), DETAIL, DETAIL))


class JobLog(_Log):
    """Shows the command and the messages of a job: warnings and stages with their times, and the output of a failed
    job. The command is first, so that it can be copied with the rest."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Select a job to see its messages.", parent)
        self.setAccessibleName("Messages of the job")
        self._handle: JobHandle | None = None
        self._shown_lines = 0
        self._state = ""

    def rewrite(self) -> None:
        self.show_job(self._handle)

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

    def refresh(self) -> None:
        """Appends new messages."""
        handle = self._handle
        if handle is None:
            return
        new = handle.history.line_count - self._shown_lines
        if new > 0:
            self._shown_lines = handle.history.line_count
            for line in list(handle.history.lines)[-new:]:
                self._write(line.kind, line.at, line.text)
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
            self.appendHtml(f'<span style="color:{ink}">{escape_html(handle.message)}</span>')
        try:
            printed = read_end(handle.job.messages, MOST_PRINTED).decode(errors="replace").strip()
        except OSError:
            return
        news = [line for line in printed.splitlines() if not any(text.partition(": ")[2] in line for text in said)]
        if news:
            self.appendPlainText(lines("\n".join(news), MOST_PRINTED, MOST_PRINTED))
