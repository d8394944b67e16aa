"""The measured values of one direction as bars, each with its threshold."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.look import colors
from app.look.metrics import type_font
from app.state.directions import figure
from nvsim.mapping.explanation.explain import Explanation, Measure

_ROW = 21  # pixels
_LEAST = 6  # minimum number of rows: the number of default criteria


class MeasureBars(QWidget):
    """One line for each criterion: name, bar from 0 to 1 with a mark at the threshold, value, and threshold."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("measureBars")
        self._measures: tuple[Measure, ...] = ()
        self._failed: Measure | None = None
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_explanation(self, explanation: Explanation | None) -> None:
        self._measures = () if explanation is None else explanation.measures
        self._failed = None if explanation is None else explanation.failed
        self.setAccessibleDescription("; ".join(_words(m) for m in self._measures))
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(300, self._rows * _ROW + 4)

    def minimumSizeHint(self) -> QSize:
        return QSize(200, self._rows * _ROW + 4)

    @property
    def _rows(self) -> int:
        return max(_LEAST, len(self._measures))

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        palette, metrics = self.palette(), painter.fontMetrics()
        ink, quiet = palette.text().color(), palette.placeholderText().color()
        names = max((metrics.horizontalAdvance(_name(m)) for m in self._measures), default=0) + 10
        figures = metrics.horizontalAdvance("0.00 > 0.00") + 6
        bar = max(30.0, self.width() - names - figures - 8.0)
        for i, measure in enumerate(self._measures):
            top = 2 + i * _ROW
            shade = ink if measure.decides else quiet
            painter.setFont(type_font(bold=measure is self._failed))
            painter.setPen(shade)
            line = Qt.AlignmentFlag.AlignVCenter
            painter.drawText(QRectF(0, top, names, _ROW), line | Qt.AlignmentFlag.AlignLeft, _name(measure))
            box = QRectF(names, top + 6, bar, _ROW - 12)
            ground = QColor(ink)
            ground.setAlpha(28)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(ground)
            painter.drawRoundedRect(box, 2, 2)
            tone = QColor(colors.OPEN if measure.passes else colors.BLOCKED)
            tone.setAlpha(255 if measure.decides else 70)
            painter.setBrush(tone)
            share = min(max(measure.value, 0.0), 1.0)
            painter.drawRoundedRect(QRectF(box.left(), box.top(), max(2.0, share * bar), box.height()), 2, 2)
            limit = box.left() + min(max(measure.limit, 0.0), 1.0) * bar
            painter.setPen(QPen(shade, 2))
            painter.drawLine(QPointF(limit, box.top() - 3), QPointF(limit, box.bottom() + 3))
            painter.setPen(shade)
            text = f"{figure(measure.value)} {measure.relation} {figure(measure.limit)}"
            right = QRectF(names + bar + 6, top, figures, _ROW)
            painter.drawText(right, line | Qt.AlignmentFlag.AlignRight, text)
        painter.end()


def _name(measure: Measure) -> str:
    return measure.name[0].upper() + measure.name[1:]


def _words(measure: Measure) -> str:
    state = "passes" if measure.passes else "fails"
    return f"{measure.name} {figure(measure.value)}, threshold {figure(measure.limit)}, {state}"
