"""The legend of a scale over an image: a color bar with its range and a mark at the current value."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QImage, QPainter, QPen

from nvsim_app.look.theme import type_font
from nvsim_app.painting.primitives import paint_label
from nvsim_app.painting.value_colors import ValueScale

_WIDTH, _BAR, _MARGIN = 172.0, 9.0, 6.0  # pixels
_SWATCH = 9.0
_INK, _GROUND = QColor("#e8edf2"), QColor(16, 20, 26, 190)
_AWAY = 14.0  # pixels between the cursor and the value beside it


def legend_box(scale: ValueScale, corner: QPointF) -> QRectF:
    """The rectangle of `paint_legend`, with its lower left corner at `corner`."""
    line = QFontMetricsF(type_font("small")).height()
    height = 2 * _MARGIN + 2 * line + (2 if scale.swatches else _BAR + 5)
    width = max(_WIDTH, sum(_widths(scale)) + 2 * _MARGIN)
    return QRectF(corner.x(), corner.y() - height, width, height)


def _widths(scale: ValueScale) -> list[float]:
    metrics = QFontMetricsF(type_font("small"))
    return [_SWATCH + 3 + metrics.horizontalAdvance(words) + 5 for _, words in scale.swatches]


def paint_legend(painter: QPainter, scale: ValueScale, corner: QPointF, value: object = None) -> QRectF:
    """Paints the legend with its lower left corner at `corner` and a mark at `value`. Returns its rectangle."""
    painter.save()
    box = legend_box(scale, corner)
    widths = _widths(scale)
    painter.setFont(type_font("small"))
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(_GROUND)
    painter.drawRoundedRect(box, 4, 4)
    line = QFontMetricsF(painter.font()).height()
    left, width = box.left() + _MARGIN, box.width() - 2 * _MARGIN
    painter.setPen(_INK)
    painter.drawText(QRectF(left, box.top() + _MARGIN - 2, width, line), Qt.AlignmentFlag.AlignLeft, scale.title)
    top = box.top() + _MARGIN + line + 1
    if scale.swatches:
        _paint_swatches(painter, scale, QPointF(left, top), line, widths)
    else:
        _paint_bar(painter, scale, QRectF(left, top, width, _BAR), line)
        share = None if value is None else scale.share(value)
        if share is not None:
            x = left + share * width
            painter.setPen(QPen(QColor("#000000"), 4))
            painter.drawLine(QPointF(x, top - 2), QPointF(x, top + _BAR + 2))
            painter.setPen(QPen(QColor("#ffffff"), 2))
            painter.drawLine(QPointF(x, top - 2), QPointF(x, top + _BAR + 2))
    painter.restore()
    return box


def _paint_bar(painter: QPainter, scale: ValueScale, bar: QRectF, line: float) -> None:
    colors = scale.colors.copy()
    image = QImage(colors.data, len(colors), 1, 3 * len(colors), QImage.Format.Format_RGB888)
    painter.drawImage(bar, image)
    metrics = QFontMetricsF(painter.font())
    for share, words in scale.marks:
        width = metrics.horizontalAdvance(words) + 1
        x = min(max(bar.left() + share * bar.width() - width / 2, bar.left()), bar.right() - width)
        painter.drawText(QRectF(x, bar.bottom() + 3, width, line), Qt.AlignmentFlag.AlignLeft, words)


def _paint_swatches(painter: QPainter, scale: ValueScale, at: QPointF, line: float, widths: list[float]) -> None:
    x = at.x()
    for (rgb, words), width in zip(scale.swatches, widths, strict=True):
        painter.fillRect(QRectF(x, at.y() + (line - _SWATCH) / 2, _SWATCH, _SWATCH), QColor(*rgb))
        place = QRectF(x + _SWATCH + 3, at.y(), width, line)
        painter.drawText(place, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, words)
        x += width


def words_box(font: QFont, words: list[str], at: QPointF, within: QRectF) -> QRectF:
    """The rectangle of `paint_values_at_cursor`: beside the point `at`, inside `within`."""
    metrics = QFontMetricsF(font)
    width = max(metrics.horizontalAdvance(w) for w in words) + 14
    height = len(words) * (metrics.height() + 6)
    x = at.x() + _AWAY if at.x() + _AWAY + width < within.right() else at.x() - _AWAY - width
    y = at.y() + _AWAY if at.y() + _AWAY + height < within.bottom() else at.y() - _AWAY - height
    return QRectF(max(x, within.left()), max(y, within.top()), width, height)


def paint_values_at_cursor(painter: QPainter, words: list[str], at: QPointF, within: QRectF) -> None:
    """Paints the values under the cursor beside it, one chip for each."""
    box = words_box(painter.font(), words, at, within)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    for row, one in enumerate(words):
        bottom = box.top() + (row + 1) * box.height() / len(words) - 1
        paint_label(painter, QPointF(box.left(), bottom), one, _INK, _GROUND)
