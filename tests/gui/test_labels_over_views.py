"""Labels at the cursor over a view."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QApplication

from nvsim_app.modes.mode import label_box

SENTENCE = (
    "No edge: the corridor is blocked by a desk, alpha 0.98 at 1.2 m, threshold 0.50; move the viewpoint or force it."
)


@pytest.mark.parametrize("at", [(10, 10), (390, 290), (200, 150)])
def test_a_long_sentence_wraps_inside_the_view(qapp: QApplication, at: tuple[int, int]) -> None:
    image = QImage(400, 300, QImage.Format.Format_RGB32)
    painter = QPainter(image)
    short, long = (label_box(painter, QPointF(*at), text) for text in ("1.90 m", SENTENCE))
    painter.end()
    assert QRectF(0, 0, 400, 300).contains(long) and QRectF(0, 0, 400, 300).contains(short)
    assert long.width() < 300 and long.height() > 2 * short.height()
