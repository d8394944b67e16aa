"""The About window: a description of NVSim, and the system report to copy."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QFontDatabase, QGuiApplication, QIcon
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QHBoxLayout, QPlainTextEdit, QVBoxLayout, QWidget

from app.look.dialog_buttons import DialogButtons
from app.look.icons import FOLDER
from app.look.labels import Label
from app.look.metrics import type_font
from app.panels.system_report import report, version_of

_WHAT = (
    "Turns images of a building with their camera poses into a simulator for vision-and-language navigation: "
    "floor-aware Gaussian models, a navigation graph with the evidence for every edge, and R2R data that existing "
    "agents load."
)


class AboutWindow(QDialog):
    """A non-modal window about NVSim."""

    def __init__(self, project: Path | None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("About NVSim")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(620, 480)
        picture = Label(self)
        picture.setPixmap(QIcon(str(FOLDER / "app.svg")).pixmap(64, 64))
        name = Label(f"NVSim {version_of('nvsim')}", self)
        name.setFont(type_font("large", bold=True))
        what = Label(_WHAT, self)
        what.setWordWrap(True)
        words = QVBoxLayout()
        words.addWidget(name)
        words.addWidget(what)
        head = QHBoxLayout()
        head.setSpacing(16)
        head.addWidget(picture, 0, Qt.AlignmentFlag.AlignTop)
        head.addLayout(words, 1)
        self.report = QPlainTextEdit(report(project), self)
        self.report.setReadOnly(True)
        self.report.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.report.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.report.setAccessibleName("System report")
        buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        self.copy = buttons.addButton("Copy system report", QDialogButtonBox.ButtonRole.ActionRole)
        self.copy.clicked.connect(self._copy)
        buttons.rejected.connect(self.close)
        layout = QVBoxLayout(self)
        layout.setSpacing(8)
        layout.addLayout(head)
        layout.addWidget(self.report, 1)
        layout.addWidget(buttons)

    def _copy(self) -> None:
        QGuiApplication.clipboard().setText(self.report.toPlainText())
        self.copy.setText("Copied")
