"""The preview of a training in the panel of jobs."""

from __future__ import annotations

from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QImage, QPainter
from pytestqt.qtbot import QtBot

from nvsim_app.panels.training_images import JobPreview


def _named_quarters(widget: JobPreview, width: int, height: int) -> list[bool]:
    """Whether something is painted in each quarter of a white image of this size."""
    image = QImage(width, height, QImage.Format.Format_RGB32)
    image.fill(QColor("white"))
    painter = QPainter(image)
    widget._paint_names(painter, QRectF(0, 0, width, height))
    painter.end()
    white = QColor("white").rgb()
    return [
        any(image.pixel(column * width // 2 + x, row * height // 2 + y) != white for x in range(4, 30) for y in (8, 12))
        for row in (0, 1)
        for column in (0, 1)
    ]


def test_each_quarter_of_a_preview_has_its_name(qtbot: QtBot) -> None:
    widget = JobPreview()
    qtbot.addWidget(widget)
    assert _named_quarters(widget, 400, 300) == [True] * 4
    assert _named_quarters(widget, 60, 40) == [False] * 4  # no room
