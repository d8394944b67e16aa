"""Shows a dialog in front of its window with the keyboard focus, which window managers do not do by themselves."""

from __future__ import annotations

from PySide6.QtWidgets import QWidget


def bring_up(window: QWidget) -> None:
    """Shows a non-modal window and gives it the keyboard focus, so that Esc closes it and Tab moves through it."""
    window.show()
    window.raise_()
    window.activateWindow()
    if window.focusWidget() is None:
        window.setFocus()
        window.focusNextPrevChild(True)
