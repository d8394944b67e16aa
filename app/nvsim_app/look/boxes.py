"""Box layouts from their items: `vbox(title, hbox(name, (edit, 1)), STRETCH, on=self, margins=4)`."""

from __future__ import annotations

from typing import TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QBoxLayout, QHBoxLayout, QLayout, QVBoxLayout, QWidget

STRETCH = None  # an item that takes the free space
Content = QWidget | QLayout | int | None
"""A widget, a layout, a gap in pixels, or STRETCH."""
Item = Content | tuple[Content, int] | tuple[QWidget, int, Qt.AlignmentFlag]
"""A content, alone or with its share of the free space, and with the alignment of a widget."""
Margins = int | tuple[int, int, int, int] | None
Box = TypeVar("Box", bound=QBoxLayout)


def hbox(*items: Item, on: QWidget | None = None, margins: Margins = None, spacing: int | None = None) -> QHBoxLayout:
    """A row of items, on a widget if `on` is given.

    `margins` (all, or left, top, right, and bottom) and `spacing` are in pixels; None keeps those of the style.
    """
    return _filled(QHBoxLayout() if on is None else QHBoxLayout(on), items, margins, spacing)


def vbox(*items: Item, on: QWidget | None = None, margins: Margins = None, spacing: int | None = None) -> QVBoxLayout:
    """A column of items, with the arguments of `hbox`."""
    return _filled(QVBoxLayout() if on is None else QVBoxLayout(on), items, margins, spacing)


def _filled(box: Box, items: tuple[Item, ...], margins: Margins, spacing: int | None) -> Box:
    if margins is not None:
        box.setContentsMargins(*(margins if isinstance(margins, tuple) else (margins,) * 4))
    if spacing is not None:
        box.setSpacing(spacing)
    for item in items:
        content, share, *alignment = item if isinstance(item, tuple) else (item, 0)
        if content is None:
            box.addStretch(share or 1)
        elif isinstance(content, int):
            box.addSpacing(content)
        elif isinstance(content, QLayout):
            box.addLayout(content, share)
        else:
            box.addWidget(content, share, *alignment)
    return box
