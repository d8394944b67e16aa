"""The labels of the window: words as they are, or our own markup. A QLabel takes for HTML what looks like it."""

from __future__ import annotations

import re
from typing import Any

from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import QLabel, QWidget

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


class MarkedLabel(Label):
    """Words in our own HTML. What comes from outside stands in it by `marked`; where that was forgotten, and it brought
    tags of its own, everything is shown as plain text."""

    def setText(self, words: str) -> None:
        ours = _OUR_TAGS.issuperset(_TAG.findall(words)) and "url(" not in words and "background" not in words
        self.setTextFormat(Qt.TextFormat.RichText if ours else Qt.TextFormat.PlainText)
        QLabel.setText(self, words if ours else folded(lines(words)))
