"""A read-only value that users can select and copy."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QLineEdit, QWidget

from app.look.plain_text import plain, tip


class Value(QLineEdit):
    """A read-only text field. The whole value can be copied, even if it is wider than the field."""

    def __init__(self, value: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setFrame(False)
        self.setTextMargins(-2, 0, 0, 0)
        palette = QPalette()  # the other colors remain those of the theme
        palette.setColor(palette.ColorRole.Base, Qt.GlobalColor.transparent)
        self.setPalette(palette)
        self.show_value(value)

    def show_value(self, value: str) -> None:
        self.setText(plain(value))
        self.setToolTip(tip(value))
        self.setCursorPosition(0)
