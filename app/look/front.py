"""How a dialog comes up: before its window and with the keyboard, which window managers give to no dialog unasked."""

from __future__ import annotations

from PySide6.QtWidgets import QWidget


def bring_up(window: QWidget) -> None:
    """Shows a window that does not block others, and gives it the keys: Esc closes it, Tab goes through it."""
    window.show()
    window.raise_()
    window.activateWindow()
    if window.focusWidget() is None:
        window.setFocus()
        window.focusNextPrevChild(True)
