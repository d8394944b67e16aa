"""Paints a row of the frame list: thumbnail, name, submap color, and a bar of the floor share. Held-out frames also
have a mark and their scores."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, QObject, QPersistentModelIndex, QPointF, QRect, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetrics, QPainter, QPalette, QPixmap
from PySide6.QtWidgets import QStyle, QStyledItemDelegate, QStyleOptionViewItem

from app.frames.model import CORRECTED_ROLE, COVERAGE_ROLE, HELD_OUT_ROLE, SCORE_ROLE, SUBMAP_ROLE
from app.frames.scores import Score
from app.look import colors
from app.look.metrics import type_font
from app.painting.primitives import chip

PICTURE = QSize(84, 63)
_MARGIN = 4
FLOOR = "#2ec4b6"


class FrameDelegate(QStyledItemDelegate):
    """Paints the rows of a list of frames."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(PICTURE.width() + 100, PICTURE.height() + 2 * _MARGIN)

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        painter.save()
        rect: QRect = option.rect
        palette: QPalette = option.palette
        state: QStyle.StateFlag = option.state
        selected = bool(state & QStyle.StateFlag.State_Selected)
        if selected:
            painter.fillRect(rect, palette.highlight())
        elif state & QStyle.StateFlag.State_MouseOver:
            painter.fillRect(rect, palette.midlight())
        picture = QRect(rect.left() + _MARGIN, rect.top() + _MARGIN, PICTURE.width(), PICTURE.height())
        _paint_picture(painter, picture, index.data(Qt.ItemDataRole.DecorationRole), palette)
        strip = QRect(picture.left(), picture.top(), 4, picture.height())
        painter.fillRect(strip, QColor(colors.submap_color(int(index.data(SUBMAP_ROLE)))))
        held_out, score = bool(index.data(HELD_OUT_ROLE)), index.data(SCORE_ROLE)
        if held_out:
            _paint_mark(painter, picture)

        text_role = QPalette.ColorRole.HighlightedText if selected else QPalette.ColorRole.Text
        quiet = palette.color(text_role)
        quiet.setAlpha(170)
        metrics: QFontMetrics = option.fontMetrics
        left, right = picture.right() + 10, rect.right() - 8
        line = metrics.height() + 2
        lines = 3 if held_out else 2
        top = rect.center().y() - (lines * line + 8) // 2
        painter.setPen(palette.color(text_role))
        name = metrics.elidedText(str(index.data()), Qt.TextElideMode.ElideLeft, right - left)
        painter.drawText(QRect(left, top, right - left, line), Qt.AlignmentFlag.AlignVCenter, name)
        share = float(index.data(COVERAGE_ROLE))
        painter.setPen(quiet)
        words = "no mask yet" if share < 0 else f"{100 * share:.0f} % floor"
        if index.data(CORRECTED_ROLE):
            words += " · corrected"
        words = metrics.elidedText(words, Qt.TextElideMode.ElideRight, right - left)
        painter.drawText(QRect(left, top + line, right - left, line), Qt.AlignmentFlag.AlignVCenter, words)
        _paint_bar(painter, QRectF(left, top + 2 * line + 3, right - left, 5), share, palette, selected)
        if held_out:
            painter.setPen(quiet)
            words = _score_words(score, metrics, right - left)
            place = QRect(left, top + 2 * line + 9, right - left, line)
            painter.drawText(place, Qt.AlignmentFlag.AlignVCenter, words)
        painter.restore()


def _score_words(score: object, metrics: QFontMetrics, width: int) -> str:
    if not isinstance(score, Score):
        return metrics.elidedText("not evaluated", Qt.TextElideMode.ElideRight, width)
    short = f"{score.psnr:.1f} dB, {score.ssim:.2f}"
    return score.words if metrics.horizontalAdvance(score.words) <= width else short


def _paint_mark(painter: QPainter, picture: QRect) -> None:
    """Marks the thumbnail of a held-out frame."""
    painter.save()
    painter.setFont(type_font("small"))
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    at = QPointF(picture.left() + 7, picture.bottom() - 2)
    chip(painter, at, "held out", QColor("#1f2730"), QColor(colors.SELECTED))
    painter.restore()


def _paint_picture(painter: QPainter, place: QRect, pixmap: object, palette: QPalette) -> None:
    if not isinstance(pixmap, QPixmap):
        painter.fillRect(place, palette.alternateBase())
        return
    # Fill the rectangle; crop the longer side equally at both ends.
    scale = max(place.width() / pixmap.width(), place.height() / pixmap.height())
    width, height = place.width() / scale, place.height() / scale
    source = QRectF((pixmap.width() - width) / 2, (pixmap.height() - height) / 2, width, height)
    painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
    painter.drawPixmap(QRectF(place), pixmap, source)


def _paint_bar(painter: QPainter, place: QRectF, share: float, palette: QPalette, selected: bool) -> None:
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    groove = palette.color(QPalette.ColorRole.HighlightedText if selected else QPalette.ColorRole.Text)
    groove.setAlpha(40)
    painter.setBrush(groove)
    painter.drawRoundedRect(place, 2.5, 2.5)
    if share > 0:
        painter.setBrush(palette.highlightedText() if selected else QColor(FLOOR))
        filled = QRectF(place.left(), place.top(), max(place.height(), place.width() * min(share, 1)), place.height())
        painter.drawRoundedRect(filled, 2.5, 2.5)
