"""The labels of the window: words as they are, or our own markup. A QLabel takes for HTML what looks like it."""

from __future__ import annotations

import re
from typing import Any

from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication, QLabel, QWidget

from app.look import colors
from app.look.plain_text import folded, lines

_WIDEST = 400  # pixels that the words of a label may claim
_TAG = re.compile(r"<\s*/?\s*([^\s/>]*)")
_OUR_TAGS = frozenset({"b", "br", "span", "table", "td", "tr"})


class Label(QLabel):
    """Words as they are. It asks for no more room than a window can give."""

    def __init__(
        self,
        words: str | QWidget | None = "",
        parent: QWidget | None = None,
        **options: Any,  # Any: Qt's properties, each of a type of its own
    ) -> None:
        """QLabel's own arguments: the words and the parent, or the parent alone."""
        own = words if isinstance(words, str) else ""
        super().__init__(parent if isinstance(words, str) else words, **options)
        self.setTextFormat(Qt.TextFormat.PlainText)
        if own:
            self.setText(own)

    def setText(self, words: str) -> None:
        super().setText(folded(lines(words)))

    def minimumSizeHint(self) -> QSize:
        hint = super().minimumSizeHint()
        return QSize(min(hint.width(), _WIDEST), hint.height())


class InkLabel(Label):
    """Words that mean something by their colour too: `ink` is a meaning of `colors.TEXTS`, "" for the usual text."""

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
            palette = QPalette()  # the other colours stay the theme's
            palette.setColor(palette.ColorRole.WindowText, wanted)
            self.setPalette(palette)


class MarkedLabel(Label):
    """Words in our own HTML. What comes from outside stands in it by `marked`; where that was forgotten, and it brought
    tags of its own, everything is shown as plain text."""

    def setText(self, words: str) -> None:
        ours = _OUR_TAGS.issuperset(_TAG.findall(words)) and "url(" not in words and "background" not in words
        self.setTextFormat(Qt.TextFormat.RichText if ours else Qt.TextFormat.PlainText)
        QLabel.setText(self, words if ours else folded(lines(words)))
