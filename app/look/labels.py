"""The labels of the window: plain text, or trusted markup. A plain QLabel interprets any text that looks like HTML."""

from __future__ import annotations

import re
from typing import Any

from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication, QLabel, QWidget

from app.look import colors
from app.look.plain_text import folded, lines
from app.look.wording import in_window

_WIDEST = 400  # maximum of the minimum width of a label, pixels
_TAG = re.compile(r"<\s*/?\s*([^\s/>]*)")
_OUR_TAGS = frozenset({"b", "br", "span", "table", "td", "tr"})


class Label(QLabel):
    """A label that shows plain text. Its minimum width is limited, so that a long word does not widen the window."""

    def __init__(
        self,
        words: str | QWidget | None = "",
        parent: QWidget | None = None,
        **options: Any,  # Any: Qt properties of different types
    ) -> None:
        """The arguments of QLabel: text and parent, or only the parent."""
        own = words if isinstance(words, str) else ""
        super().__init__(parent if isinstance(words, str) else words, **options)
        self.setTextFormat(Qt.TextFormat.PlainText)
        if own:
            self.setText(own)

    def setText(self, words: str) -> None:
        super().setText(folded(lines(in_window(words))))

    def minimumSizeHint(self) -> QSize:
        hint = super().minimumSizeHint()
        return QSize(min(hint.width(), _WIDEST), hint.height())


class InkLabel(Label):
    """A label whose color has a meaning: `ink` is a key in `colors.TEXTS`, "" for the normal text color."""

    def __init__(self, ink: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.set_ink(ink)

    def set_ink(self, ink: str) -> None:
        self._ink = ink
        self._dress()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_ink"):
            self._dress()
        super().changeEvent(event)

    def _dress(self) -> None:
        wanted = QColor(colors.text(self._ink)) if self._ink else QApplication.palette().windowText().color()
        if self.palette().windowText().color() != wanted:
            palette = QPalette()  # the other colors remain those of the theme
            palette.setColor(palette.ColorRole.WindowText, wanted)
            self.setPalette(palette)


class MarkedLabel(Label):
    """A label with trusted HTML. Text from outside must pass through `marked`. If the HTML contains unexpected tags,
    everything is shown as plain text."""

    def setText(self, words: str) -> None:
        ours = _OUR_TAGS.issuperset(_TAG.findall(words)) and "url(" not in words and "background" not in words
        self.setTextFormat(Qt.TextFormat.RichText if ours else Qt.TextFormat.PlainText)
        QLabel.setText(self, words if ours else folded(lines(words)))
