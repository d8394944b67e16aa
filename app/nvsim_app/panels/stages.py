"""The missing stages of a project in the center of the window and in a bar over the 3D view, and its earlier
results."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QObject, QSize, Qt, Signal, SignalInstance
from PySide6.QtGui import QImage, QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import (
    QBoxLayout,
    QDialogButtonBox,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from nvsim.project.earlier_results import KeptResult, megabytes
from nvsim.project.work import PIPELINE, WORK
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.icons import icon
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import plain
from nvsim_app.look.theme import GRID, type_font
from nvsim_app.look.widgets import Dialog, DialogButtons, named, push_button
from nvsim_app.panels.job_table import duration


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

    def show_message(self, sentence: str, verb: str) -> None:
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
        self.bar = named(QProgressBar(self, textVisible=False), "Progress of the job")
        self.bar.setRange(0, 1000)
        self.bar.setFixedSize(90, 10)
        hbox(self.words, self.bar, on=self, margins=(4, 0, 8, 0))
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


class EmptyState(QWidget):
    """A sentence, and buttons that run the missing stage.

    Signals: importWanted(), runWanted(), stageWanted(verb), settingsWanted(verb).
    """

    importWanted = Signal()
    runWanted = Signal()
    stageWanted = Signal(str)
    settingsWanted = Signal(str)

    def __init__(self) -> None:
        super().__init__(autoFillBackground=True)
        self._verb = ""
        self._mark = Label(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence = Label(self, alignment=Qt.AlignmentFlag.AlignCenter, wordWrap=True, font=type_font("large"))
        self.imports = self._button("Import a capture…", self.importWanted.emit)
        self.everything = self._button("Run everything", self.runWanted.emit)
        self.stage = self._button("This stage only", lambda: self.stageWanted.emit(self._verb))
        self.settings = self._button("Settings…", lambda: self.settingsWanted.emit(self._verb))
        buttons = hbox(STRETCH, self.imports, self.everything, self.stage, self.settings, STRETCH)
        vbox((STRETCH, 2), self._mark, 8, self.sentence, 6, buttons, (STRETCH, 3), on=self)
        self.apply_palette()
        self.show_message("")

    def _button(self, text: str, handler: object) -> QPushButton:
        return push_button(text, self, handler)

    def apply_palette(self) -> None:
        """Draws the logo in the colors of the palette."""
        self._logo = icon("nvsim", self.palette()).pixmap(48, 48)
        self._mark.setPixmap(self._logo)

    def show_message(self, sentence: str, verb: str = "", image: QImage | None = None) -> None:
        """Shows a sentence. `verb` is the missing stage, or "" if no stage can be started. `image` is shown above the
        sentence in place of the logo."""
        self._verb = verb
        if image is None or image.isNull():
            self._mark.setPixmap(self._logo)
        else:
            size = QSize(min(640, self.width()), max(48, self.height() // 2))
            smooth = Qt.TransformationMode.SmoothTransformation
            self._mark.setPixmap(QPixmap.fromImage(image).scaled(size, Qt.AspectRatioMode.KeepAspectRatio, smooth))
        self.sentence.setText(sentence)
        if verb in PIPELINE:
            self.stage.setText(f"{WORK[verb].title} only")
        self.imports.setVisible(verb == "import")
        for button in (self.everything, self.stage, self.settings):
            button.setVisible(verb in PIPELINE)


class EarlierResults(Dialog):
    """Lists the earlier results.

    chosen(stage: str, discard: bool): restore the earlier result of a stage, or delete it if `discard` is true.
    """

    chosen = Signal(str, bool)

    def __init__(self, kept: Sequence[KeptResult], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Earlier results")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        intro = Label(
            "Each row is the result of a stage before its last run. Restore exchanges it with the current result; "
            "later stages do not change.",
            self,
            wordWrap=True,
        )
        self.list = named(QListWidget(self), "Earlier results")
        for one in kept:
            item = QListWidgetItem(f"{one.stage}: {one.words}, {megabytes(one.bytes)}", self.list)
            item.setData(Qt.ItemDataRole.UserRole, one.stage)
        self.list.setCurrentRow(0)
        self.list.itemDoubleClicked.connect(lambda _: self._choose(False))
        buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        self.restore_button = buttons.addButton("Restore", QDialogButtonBox.ButtonRole.AcceptRole)
        self.discard_button = buttons.addButton("Delete", QDialogButtonBox.ButtonRole.DestructiveRole)
        self.discard_button.setToolTip("Frees disk space; the current result stays")
        self.restore_button.clicked.connect(lambda: self._choose(False))
        self.discard_button.clicked.connect(lambda: self._choose(True))
        buttons.rejected.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.addWidget(intro)
        layout.addWidget(self.list)
        layout.addWidget(buttons)
        self.resize(620, 260)

    def _choose(self, discard: bool) -> None:
        item = self.list.currentItem()
        if item is not None:
            self.chosen.emit(item.data(Qt.ItemDataRole.UserRole), discard)
            self.accept()
