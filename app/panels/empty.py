"""What the centre shows while there is nothing to see: what is missing, and the command that makes it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QFont, QFontDatabase, QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from app.icons import icon


class EmptyState(QWidget):
    """A sentence and a command that can be copied."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAutoFillBackground(True)
        self._mark = QLabel(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence = QLabel(self, alignment=Qt.AlignmentFlag.AlignCenter)
        self.sentence.setWordWrap(True)
        font = QFont(self.sentence.font())
        font.setPointSizeF(font.pointSizeF() + 3)
        self.sentence.setFont(font)
        hint = QLabel("This command makes it; the window follows by itself:", self)
        hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        hint.setForegroundRole(hint.palette().ColorRole.PlaceholderText)
        self.command = QLineEdit(self)
        self.command.setReadOnly(True)
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.command.setMinimumWidth(460)
        copy = QPushButton("Copy", self)
        copy.clicked.connect(lambda: QGuiApplication.clipboard().setText(self.command.text()))
        row = QHBoxLayout()
        row.addStretch(1)
        row.addWidget(self.command, 4)
        row.addWidget(copy)
        row.addStretch(1)
        layout = QVBoxLayout(self)
        layout.addStretch(2)
        layout.addWidget(self._mark)
        layout.addSpacing(8)
        layout.addWidget(self.sentence)
        layout.addWidget(hint)
        layout.addLayout(row)
        layout.addStretch(3)
        self.dress()

    def dress(self) -> None:
        """Draws the mark in the palette's colours."""
        self._mark.setPixmap(icon("nvsim", self.palette()).pixmap(48, 48))

    def say(self, sentence: str, command: str) -> None:
        self.sentence.setText(sentence)
        self.command.setText(command)
        self.command.setCursorPosition(0)
