"""Help pages from resources/help, shown in a window of their own."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QTextBrowser, QVBoxLayout, QWidget

import resources

FOLDER = Path(resources.__file__).parent / "help"


class HelpWindow(QDialog):
    """Not modal: it can stay open beside the window it explains."""

    def __init__(self, page: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("NVSim help")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(560, 620)
        self.text = QTextBrowser(self)
        self.text.setFrameShape(self.text.Shape.NoFrame)
        self.text.setOpenExternalLinks(False)
        self.text.setMarkdown((FOLDER / f"{page}.md").read_text(encoding="utf-8"))
        layout = QVBoxLayout(self)
        layout.addWidget(self.text)
