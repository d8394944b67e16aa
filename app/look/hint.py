"""A text in the center of an empty list or plot that describes the missing content and how to get it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QAbstractItemView, QAbstractScrollArea

from app.look.labels import Label

_MARGIN = 14  # pixels


class Hint(Label):
    """A label over the viewport of `area` that ignores the mouse.

    words  returns the current text, "" if the area is not empty
    """

    def __init__(self, area: QAbstractScrollArea, words: Callable[[], str]) -> None:
        super().__init__(area.viewport())
        self._under = area.viewport()
        self._words = words
        self.setObjectName("hint")
        self.setWordWrap(True)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setForegroundRole(self.palette().ColorRole.PlaceholderText)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        area.viewport().installEventFilter(self)
        self.refresh()

    def follow(self, view: QAbstractItemView) -> Hint:
        """Refreshes whenever the rows of `view` change."""
        model = view.model()
        for changed in (model.modelReset, model.rowsInserted, model.rowsRemoved, model.layoutChanged):
            changed.connect(self.refresh)
        return self

    def refresh(self) -> None:
        words = self._words()
        self.setText(words)
        self.setVisible(bool(words))
        self._fit()

    def _fit(self) -> None:
        self.setGeometry(self._under.rect().adjusted(_MARGIN, 4, -_MARGIN, -4))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self._fit()
        return super().eventFilter(watched, event)
