"""Notices: sentences at the edge of the view that need no answer, instead of modal dialogs. They are also logged."""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Literal

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QEnterEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QFrame, QVBoxLayout, QWidget

from nvsim.errors import InputError
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import lines
from nvsim_app.look.theme import GRID
from nvsim_app.look.widgets import tool_button

Severity = Literal["log", "info", "warning", "error"]
SECONDS: dict[Severity, float] = {"info": 6.0, "warning": 12.0, "error": 40.0}
MOST_SHOWN = 4
WIDTH, NARROWEST = 380, 160  # pixels: the width of a notice, and the least width in a narrow view
MOST_LETTERS, MOST_ROWS = 600, 12  # maximum number of characters and lines of a shown notice
_SIGNS: dict[Severity, str] = {"info": "", "warning": "⚠ ", "error": "✗ "}
_EDGE = {"info": colors.NODE, "warning": colors.SELECTED, "error": colors.BLOCKED}


@dataclass(frozen=True)
class Notice:
    """A notice.

    severity   "log" is written to the log but not shown
    text       one sentence
    detail     details for the log, such as a traceback
    about      what it is about; a newer notice about the same, such as its success, replaces it
    when       seconds since the epoch
    """

    severity: Severity
    text: str
    detail: str = ""
    about: str = ""
    when: float = 0.0


class Notices(QObject):
    """The stream of notices: emits added(Notice), and resolved(str) after a success without a notice. Can be called
    from any thread."""

    added = Signal(object)
    resolved = Signal(str)

    def add(self, severity: Severity, text: str, detail: str = "", about: str = "") -> None:
        self.added.emit(Notice(severity, text, detail, about, time.time()))

    def info(self, text: str, about: str = "") -> None:
        self.add("info", text, about=about)

    def warning(self, text: str, detail: str = "", about: str = "") -> None:
        self.add("warning", text, detail, about)

    def error(self, text: str, detail: str = "", about: str = "") -> None:
        self.add("error", text, detail, about)

    @contextmanager
    def reporting(self, about: str = "") -> Iterator[None]:
        """Shows an InputError of the `with` block as an error. The program then continues after the block."""
        try:
            yield
        except InputError as error:
            self.error(str(error), about=about)

    def resolve(self, about: str) -> None:
        """Removes the notices about something that has succeeded since."""
        self.resolved.emit(about)


class _NoticeCard(QFrame):
    """A notice on the screen. It stays while the pointer is over it; then its time restarts."""

    def __init__(self, notice: Notice, close: Callable[[], None], explain: Callable[[], None], parent: QWidget) -> None:
        super().__init__(parent)
        self.notice = notice
        # The log has the complete text.
        self._words = _SIGNS[notice.severity] + lines(notice.text, MOST_LETTERS, MOST_ROWS)
        self.count = 1
        self._timer = QTimer(self, singleShot=True)
        self._timer.timeout.connect(close)
        self._timer.setInterval(int(1000 * SECONDS[notice.severity]))
        self._timer.start()
        self._label = Label(self, text=self._words, wordWrap=True, selectable=True)
        button = tool_button("×", self, close, "Close this notice", autoRaise=True)
        words = vbox(self._label, spacing=4)
        if notice.detail:
            more = tool_button("Details in the log", self, explain, autoRaise=True, objectName="noticeDetails")
            words.addWidget(more, 0, Qt.AlignmentFlag.AlignLeft)
        hbox((words, 1), (button, 0, Qt.AlignmentFlag.AlignTop), on=self, margins=(16, 8, 8, 8))

    def enterEvent(self, event: QEnterEvent) -> None:
        self._timer.stop()
        super().enterEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._timer.start()
        super().leaveEvent(event)

    def repeat(self) -> None:
        self.count += 1
        self._timer.start()
        self._label.setText(f"{self._words} ({self.count} times)")

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        palette = self.palette()
        painter.setPen(palette.mid().color())
        painter.setBrush(palette.toolTipBase())
        painter.drawRoundedRect(self.rect().adjusted(0, 0, -1, -1), 6, 6)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(_EDGE[self.notice.severity]))
        painter.drawRoundedRect(5, 8, 4, self.height() - 16, 2, 2)


class NoticeArea(QWidget):
    """A stack of notices in the upper right corner of its parent, the newest at the bottom. detailsWanted(Notice): the
    user wants the details of a notice."""

    detailsWanted = Signal(object)

    def __init__(self, notices: Notices, parent: QWidget) -> None:
        super().__init__(parent)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(8)
        self._cards: list[_NoticeCard] = []
        parent.installEventFilter(self)
        notices.added.connect(self.show_notice)
        notices.resolved.connect(self.resolve)
        self.hide()

    @property
    def texts(self) -> list[str]:
        """The texts on the screen."""
        return [card.notice.text for card in self._cards]

    def show_notice(self, notice: Notice) -> None:
        if notice.severity == "log":
            return
        if notice.about:
            self.resolve(notice.about, but=notice)
        for card in self._cards:
            if (card.notice.text, card.notice.severity) == (notice.text, notice.severity):
                card.repeat()
                self._place()
                return
        if len(self._cards) >= MOST_SHOWN:
            # Errors are removed last.
            self._close(next((c for c in self._cards if c.notice.severity != "error"), self._cards[0]))
        card = _NoticeCard(notice, lambda: self._close(card), lambda: self.detailsWanted.emit(notice), self)
        self._cards.append(card)
        self._layout.addWidget(card)
        card.show()
        self._place()

    def resolve(self, about: str, but: Notice | None = None) -> None:
        """Removes the notices about something, except those that say the same as `but`."""
        for card in list(self._cards):
            if card.notice.about == about and (but is None or card.notice.text != but.text):
                self._close(card)

    def clear(self) -> None:
        """Removes all notices, because another file is opened."""
        for card in list(self._cards):
            self._close(card)

    def _close(self, card: _NoticeCard) -> None:
        if card in self._cards:
            self._cards.remove(card)
            self._layout.removeWidget(card)
            card.hide()
            card.deleteLater()
        self._place()

    def _place(self) -> None:
        self.setVisible(bool(self._cards))
        parent = self.parentWidget()
        assert parent is not None  # given at construction
        for card in self._cards:
            card.setFixedWidth(max(NARROWEST, min(WIDTH, parent.width() - 2 * GRID)))
        self.adjustSize()
        self.move(max(0, parent.width() - self.width() - GRID), GRID)
        self.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self._cards:
            self._place()
        return super().eventFilter(watched, event)


def install_excepthook(notices: Notices) -> Callable[[], None]:
    """Shows uncaught exceptions as notices, and prints their traceback to stderr.

    Call it after importing pyqtgraph, which installs its own hook. Returns a function that restores the previous
    hooks."""
    former, former_thread = sys.excepthook, threading.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            former(kind, error, trace)
            return
        text = "".join(traceback.format_exception(kind, error, trace))
        # A painter among the variables of a paint event would still be active when Qt ends the painting, and crash it.
        traceback.clear_frames(trace)
        if isinstance(error, InputError):
            notices.error(str(error))
            return
        print(text, file=sys.stderr)
        notices.error(f"Unexpected error: {error or kind.__name__}. The log has the details.", text)

    def thread_hook(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            hook(args.exc_type, args.exc_value, args.exc_traceback)

    sys.excepthook, threading.excepthook = hook, thread_hook

    def restore() -> None:
        sys.excepthook, threading.excepthook = former, former_thread

    return restore
