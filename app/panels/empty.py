"""What the centre shows while there is nothing to see: what is missing, the buttons that make it, and the command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFont, QFontDatabase, QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QLineEdit, QPushButton, QVBoxLayout, QWidget

from app.look.icons import icon
from app.look.labels import Label
from app.look.plain_text import SENTENCE, caption, plain, tip
from nvsim.project.work import PIPELINE, WORK

MOST_RECENT = 4


class EmptyState(QWidget):
    """A sentence, what can be done about it, and a command that can be copied.

    newWanted(), importWanted(), demoWanted(), openWanted(), recentWanted(Path), runWanted(), stageWanted(verb),
    settingsWanted(verb).
    """

    newWanted = Signal()
    importWanted = Signal()
    demoWanted = Signal()
    openWanted = Signal()
    recentWanted = Signal(object)
    runWanted = Signal()
    stageWanted = Signal(str)
    settingsWanted = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAutoFillBackground(True)
        self._verb = self._command = ""
        self._mark = Label(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence = Label(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence.setWordWrap(True)
        font = QFont(self.sentence.font())
        font.setPointSizeF(font.pointSizeF() + 3)
        self.sentence.setFont(font)
        self.new = self._button("New project from a capture…", self.newWanted.emit)
        self.open = self._button("Open project…", self.openWanted.emit)
        self.demo = self._button("Try the built-in building…", self.demoWanted.emit)
        self.imports = self._button("Import a capture…", self.importWanted.emit)
        self.everything = self._button("Run everything", self.runWanted.emit)
        self.stage = self._button("This stage only", lambda: self.stageWanted.emit(self._verb))
        self.settings = self._button("Settings…", lambda: self.settingsWanted.emit(self._verb))
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        for button in (self.new, self.open, self.demo, self.imports, self.everything, self.stage, self.settings):
            buttons.addWidget(button)
        buttons.addStretch(1)
        self._recent = QVBoxLayout()
        self._recent.setSpacing(2)
        self.recent_buttons: list[QPushButton] = []
        self.hint = Label("Or in a terminal; the window follows by itself:", self)
        self.hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.hint.setForegroundRole(self.hint.palette().ColorRole.PlaceholderText)
        self.command = QLineEdit(self)
        self.command.setAccessibleName("Command")
        self.command.setReadOnly(True)
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.command.setMinimumWidth(300)
        self.copy = QPushButton("Copy", self)
        self.copy.clicked.connect(lambda: QGuiApplication.clipboard().setText(self._command))
        row = QHBoxLayout()
        row.addStretch(1)
        row.addWidget(self.command, 4)
        row.addWidget(self.copy)
        row.addStretch(1)
        layout = QVBoxLayout(self)
        layout.addStretch(2)
        layout.addWidget(self._mark)
        layout.addSpacing(8)
        layout.addWidget(self.sentence)
        layout.addSpacing(6)
        layout.addLayout(buttons)
        layout.addLayout(self._recent)
        layout.addSpacing(10)
        layout.addWidget(self.hint)
        layout.addLayout(row)
        layout.addStretch(3)
        self.dress()
        self.say("", "")

    def _button(self, text: str, handler: object) -> QPushButton:
        button = QPushButton(text, self)
        button.clicked.connect(handler)
        return button

    def dress(self) -> None:
        """Draws the mark in the palette's colours."""
        self._mark.setPixmap(icon("nvsim", self.palette()).pixmap(48, 48))

    def say(self, sentence: str, command: str, verb: str = "", has_project: bool = False) -> None:
        """`verb` is the stage that is missing, "" while no stage can be started."""
        self._verb = verb
        self.sentence.setText(sentence)
        self._command = command
        self.command.setText(plain(command, SENTENCE))
        self.command.setCursorPosition(0)
        for widget in (self.hint, self.command, self.copy):
            widget.setVisible(bool(command))
        if verb in PIPELINE:
            self.stage.setText(f"{WORK[verb].title} only")
        for button in (self.new, self.open, self.demo):
            button.setVisible(not has_project)
        self.imports.setVisible(has_project and verb == "import")
        for button in (self.everything, self.stage, self.settings):
            button.setVisible(verb in PIPELINE)
        for button in self.recent_buttons:
            button.setVisible(not has_project)

    def show_recent(self, paths: Sequence[Path]) -> None:
        """Offers these projects while none is open."""
        for button in self.recent_buttons:
            self._recent.removeWidget(button)
            button.deleteLater()
        self.recent_buttons = []
        for path in paths[:MOST_RECENT]:
            button = QPushButton(caption(f"{path.name}   in {path.parent}"), self)
            button.setToolTip(tip(path))
            button.setFlat(True)
            button.setCursor(Qt.CursorShape.PointingHandCursor)
            button.clicked.connect(lambda _=False, p=path: self.recentWanted.emit(p))
            button.setVisible(not self.new.isHidden())
            self._recent.addWidget(button, 0, Qt.AlignmentFlag.AlignHCenter)
            self.recent_buttons.append(button)
