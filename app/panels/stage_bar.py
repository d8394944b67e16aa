"""The bar over the 3D view that offers the next missing stage, and the running job in the status bar."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt, Signal, SignalInstance
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QBoxLayout, QHBoxLayout, QProgressBar, QPushButton, QSizePolicy, QWidget

from app.jobs.queue import JobQueue
from app.look.labels import Label
from app.look.metrics import GRID
from app.look.plain_text import plain
from app.panels.job_table import duration
from nvsim.project.work import PIPELINE, WORK


class StageBar(QWidget):
    """A sentence about the missing stage, and buttons that run it.

    Signals: runWanted(), stageWanted(verb), settingsWanted(verb).
    """

    runWanted = Signal()
    stageWanted = Signal(str)
    settingsWanted = Signal(str)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._verb = ""
        self.sentence = Label(self)
        self.everything = QPushButton("Run everything", self)
        self.stage = QPushButton("This stage only", self)
        self.settings = QPushButton("Settings…", self)
        self.everything.clicked.connect(self.runWanted)
        self.stage.clicked.connect(lambda: self._ask(self.stageWanted))
        self.settings.clicked.connect(lambda: self._ask(self.settingsWanted))
        self._halves = QBoxLayout(QBoxLayout.Direction.LeftToRight, self)
        self._halves.setContentsMargins(16, 8, 8, 8)
        self._halves.setSpacing(8)
        self._halves.addWidget(self.sentence)
        self._buttons = row = QBoxLayout(QBoxLayout.Direction.LeftToRight)
        row.setSpacing(8)
        self._halves.addLayout(row)
        for button in (self.everything, self.stage, self.settings):
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # the view keeps the keyboard focus
            row.addWidget(button)
        parent.installEventFilter(self)
        self.hide()

    def say(self, sentence: str, verb: str) -> None:
        """Offers the stage `verb`. Hides the bar if `verb` is not a stage that can be started."""
        self._verb = verb
        self.sentence.setText(sentence)
        if verb in PIPELINE:
            self.stage.setText(f"{WORK[verb].title} only")
        self.setVisible(verb in PIPELINE)
        self._place()

    def _ask(self, wanted: SignalInstance) -> None:
        if self._verb in PIPELINE:  # a click may arrive after the offer disappeared
            wanted.emit(self._verb)

    def _place(self) -> None:
        parent = self.parentWidget()
        assert parent is not None  # given at construction
        room = parent.width() - 2 * GRID
        beside, below = QBoxLayout.Direction.LeftToRight, QBoxLayout.Direction.TopToBottom
        # The sentence is above the buttons if there is no room beside them, and the buttons below each other.
        for halves, buttons in ((beside, beside), (below, beside), (below, below)):
            self._halves.setDirection(halves)
            self._buttons.setDirection(buttons)
            self.sentence.setWordWrap(halves == below)
            if (self.sizeHint() if halves == beside else self.minimumSizeHint()).width() <= room:
                break
        if halves == beside:
            self.adjustSize()
        else:
            words = self.sentence.fontMetrics().horizontalAdvance(self.sentence.text()) + 4 * GRID
            width = min(room, max(self.minimumSizeHint().width(), words))
            self.resize(width, self.heightForWidth(width))
        self.move(max(0, (parent.width() - self.width()) // 2), max(0, parent.height() - self.height() - 44))
        self.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self._place()
        return super().eventFilter(watched, event)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(self.palette().mid().color())
        painter.setBrush(self.palette().toolTipBase())
        painter.drawRoundedRect(self.rect().adjusted(0, 0, -1, -1), 6, 6)


class RunningJob(QWidget):
    """The running job in the status bar: title, progress, and time left. clicked(): the user clicked it."""

    clicked = Signal()

    def __init__(self, queue: JobQueue, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.words = Label(self)
        self.bar = QProgressBar(self)
        self.bar.setAccessibleName("Progress of the job")
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedSize(90, 10)
        row = QHBoxLayout(self)
        row.setContentsMargins(4, 0, 8, 0)
        row.addWidget(self.words)
        row.addWidget(self.bar)
        self.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Preferred)
        queue.changed.connect(self.refresh)
        queue.progressed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Shows a running job, heavy jobs first. Hides the widget if no job runs."""
        running = sorted(self._queue.running, key=lambda h: not h.job.order.heavy)
        self.setVisible(bool(running))
        if not running:
            return
        handle = running[0]
        left = handle.history.seconds_left
        words = f"{plain(handle.title, 60)}  {100 * handle.history.share:.0f} %"
        self.words.setText(words if left is None else f"{words}, {duration(left)} left")
        self.bar.setValue(round(1000 * handle.history.share))

    def mouseReleaseEvent(self, event: QEvent) -> None:
        self.clicked.emit()
