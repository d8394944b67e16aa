"""The sizes of the window: the type scale and the grid of margins and spacing. All parts of the window use them."""

from __future__ import annotations

from typing import Literal

from PySide6.QtGui import QFont, QFontInfo
from PySide6.QtWidgets import QApplication

GRID = 8
"""Margins and spacing in pixels are multiples of this, or half of it inside a group of controls."""
HALF = GRID // 2

Size = Literal["small", "text", "large"]
_SCALE: dict[Size, float] = {"small": 0.88, "text": 1.0, "large": 1.35}


def type_font(size: Size = "text", bold: bool = False) -> QFont:
    """The font of the application in one of three sizes and two weights."""
    font = QApplication.font()
    font.setPointSizeF(points(size))
    font.setBold(bold)
    return font


def points(size: Size) -> float:
    """The points of a size, rounded to halves."""
    return round(2 * QFontInfo(QApplication.font()).pointSizeF() * _SCALE[size]) / 2
