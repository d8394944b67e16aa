"""Gives the keys of Undo and Redo to the window if the focused text field has nothing to undo or redo.

Qt gives these keys to every text field, also to one without a change.
"""

from __future__ import annotations

from typing import Protocol

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QAbstractSpinBox, QApplication, QComboBox, QLineEdit, QMainWindow, QPlainTextEdit, QWidget
from shiboken6 import isValid


class TextUndo(QObject):
    """Watches the focused widget of the application. Dialogs of the window that are not modal use the keys too."""

    def __init__(self, undo: QAction, redo: QAction, window: QMainWindow) -> None:
        super().__init__(window)
        self._undo, self._redo, self._window = undo, redo, window
        self._focused: QWidget | None = None
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        app.focusChanged.connect(self._on_focus)

    def _on_focus(self, _: QWidget | None, now: QWidget | None) -> None:
        if self._focused is not None and isValid(self._focused):
            self._focused.removeEventFilter(self)
        self._focused = now
        if now is not None:
            now.installEventFilter(self)

    def _is_in_window(self, widget: QWidget) -> bool:
        """Whether a widget is in the window or in one of its dialogs."""
        window: QWidget | None = widget.window()
        while window is not None and window is not self._window:
            window = window.parentWidget()
        return window is not None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() != QEvent.Type.ShortcutOverride or not isinstance(event, QKeyEvent):
            return False
        keys = QKeySequence(event.keyCombination())
        action = next((each for each in (self._undo, self._redo) if each.shortcut() == keys), None)
        if action is None or not isinstance(watched, QWidget) or QApplication.activeModalWidget() is not None:
            return False
        if not self._is_in_window(watched):
            return False  # another main window watches it
        text = _text_of(watched)
        if text is not None and (text.isUndoAvailable() if action is self._undo else text.isRedoAvailable()):
            return False
        if watched.window() is not self._window:
            action.trigger()  # shortcuts of the window do not work in its dialogs
            event.accept()
            return True
        if text is not None:
            event.ignore()  # the window's shortcut follows
        return text is not None


class _Text(Protocol):
    """A text with an undo history."""

    def isUndoAvailable(self) -> bool: ...

    def isRedoAvailable(self) -> bool: ...


def _text_of(widget: QWidget) -> _Text | None:
    """The text with an undo history of a widget; None if it has none."""
    if isinstance(widget, QAbstractSpinBox | QComboBox):
        return widget.lineEdit()
    if isinstance(widget, QPlainTextEdit):
        return widget.document()
    return widget if isinstance(widget, QLineEdit) else None
