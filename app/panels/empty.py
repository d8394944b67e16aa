"""The center of the window while a project has nothing to show: the missing stage, and buttons that run it."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from app.look.icons import icon
from app.look.labels import Label
from app.look.metrics import type_font
from nvsim.project.work import PIPELINE, WORK


class EmptyState(QWidget):
    """A sentence, and buttons that run the missing stage.

    Signals: importWanted(), runWanted(), stageWanted(verb), settingsWanted(verb).
    """

    importWanted = Signal()
    runWanted = Signal()
    stageWanted = Signal(str)
    settingsWanted = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAutoFillBackground(True)
        self._verb = ""
        self._mark = Label(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence = Label(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence.setWordWrap(True)
        self.sentence.setFont(type_font("large"))
        self.imports = self._button("Import a capture…", self.importWanted.emit)
        self.everything = self._button("Run everything", self.runWanted.emit)
        self.stage = self._button("This stage only", lambda: self.stageWanted.emit(self._verb))
        self.settings = self._button("Settings…", lambda: self.settingsWanted.emit(self._verb))
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        for button in (self.imports, self.everything, self.stage, self.settings):
            buttons.addWidget(button)
        buttons.addStretch(1)
        layout = QVBoxLayout(self)
        layout.addStretch(2)
        layout.addWidget(self._mark)
        layout.addSpacing(8)
        layout.addWidget(self.sentence)
        layout.addSpacing(6)
        layout.addLayout(buttons)
        layout.addStretch(3)
        self.dress()
        self.say("")

    def _button(self, text: str, handler: object) -> QPushButton:
        button = QPushButton(text, self)
        button.clicked.connect(handler)
        return button

    def dress(self) -> None:
        """Draws the logo in the colors of the palette."""
        self._mark.setPixmap(icon("nvsim", self.palette()).pixmap(48, 48))

    def say(self, sentence: str, verb: str = "") -> None:
        """Shows a sentence. `verb` is the missing stage, or "" if no stage can be started."""
        self._verb = verb
        self.sentence.setText(sentence)
        if verb in PIPELINE:
            self.stage.setText(f"{WORK[verb].title} only")
        self.imports.setVisible(verb == "import")
        for button in (self.everything, self.stage, self.settings):
            button.setVisible(verb in PIPELINE)
