"""The thresholds that can be decided again from stored evidence, and their sliders, with marks at the values of the
project, the defaults, and the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from PySide6.QtCore import QPointF, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPalette, QPolygonF, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QSlider, QStyle, QStyleOptionSlider, QWidget

from nvsim.mapping import criteria
from nvsim.mapping.config import WIDEST, MappingConfig
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import NumberBox, named


@dataclass(frozen=True)
class Threshold:
    """One slider.

    field       of MappingConfig
    name, unit  for the user; unit "" for a share
    low, high   range of the slider
    step        of the slider and of its number
    worst_only  whether only the rule "worst" uses it
    family      criterion that must be selected for it to decide; "" if it always decides
    """

    field: str
    name: str
    low: float
    high: float
    step: float = 0.01
    unit: str = ""
    worst_only: bool = False
    family: str = ""

    def value_in(self, config: MappingConfig) -> float:
        return float(getattr(config, self.field))

    @property
    def steps(self) -> int:
        return round((self.high - self.low) / self.step)

    def to_step(self, value: float) -> int:
        return min(max(round((value - self.low) / self.step), 0), self.steps)

    def to_value(self, step: int) -> float:
        # Rounded, so that 0.95 is not displayed as a neighboring float.
        return round(self.low + step * self.step, 6)


def thresholds() -> tuple[Threshold, ...]:
    """One threshold for each criterion, then those of the robot and the trajectory."""
    return (
        *(Threshold(c.field, c.label, 0.0, 1.0, worst_only=c.worst_only, family=c.family) for c in criteria.CRITERIA),
        Threshold("robot_radius", "Robot's radius", 0.0, 0.45, unit="m"),
        Threshold("margin", "Margin on each side", 0.0, 0.2, unit="m"),
        Threshold("max_distance", "Distance to trajectory", 0.0, 10.0, 0.1, "m"),
    )


FIXED = (
    *("tau_dist", "merge_radius", "checked_merges", "start", "starts", "isolated", "cover_distance", "max_viewpoints"),
    *("standing", "lattice_offset", "jitter", "settle", "reach", "stretch", "around", "view_size", "second_opinion"),
    *("views", "panorama_width", "normals_model", "photographed"),
)
"""Settings that determine the places or renders of viewpoints. The evidence cannot decide other values of them."""


def with_value(config: MappingConfig, field: str, value: bool | float | str | tuple[str, ...]) -> MappingConfig:
    """`config` with another value. If the robot would be too wide for the evidence, reduces its margin or radius."""
    values = {**vars(config), field: value}
    other = {"robot_radius": "margin", "margin": "robot_radius"}.get(field)
    if other is not None and isinstance(value, int | float):
        values[other] = round(max(0.0, min(values[other], WIDEST / 2 - value)), 6)
    return MappingConfig(**values)


def preset(config: MappingConfig, like: MappingConfig) -> MappingConfig:
    """`config` with the thresholds of `like`. Settings that cannot be decided again keep their values."""
    return MappingConfig(**{name: getattr(config if name in FIXED else like, name) for name in vars(config)})


MARKS = {"project": colors.NODE, "default": colors.TRAJECTORY, "paper": colors.WARNING}
_SIZES = {"project": 6.0, "default": 4.5, "paper": 3.0}  # pixels; overlapping marks stay visible


class MarkedSlider(QSlider):
    """A slider with integer steps and small triangular marks below the groove."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._marks: dict[str, int] = {}
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def set_marks(self, marks: Mapping[str, int]) -> None:
        self._marks = dict(marks)
        self.update()

    def sizeHint(self) -> QSize:
        hint = super().sizeHint()
        return QSize(hint.width(), hint.height() + 8)

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        style, control = self.style(), QStyle.ComplexControl.CC_Slider
        handle = style.subControlRect(control, option, QStyle.SubControl.SC_SliderHandle, self)
        span = self.width() - handle.width()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        for name, step in sorted(self._marks.items(), key=lambda mark: -_SIZES[mark[0]]):
            x = handle.width() / 2 + QStyle.sliderPositionFromValue(self.minimum(), self.maximum(), step, span)
            painter.setBrush(QColor(MARKS[name]))
            bottom, size = self.height() - 0.5, _SIZES[name]
            painter.drawPolygon(
                QPolygonF([QPointF(x - size, bottom), QPointF(x, bottom - 1.3 * size), QPointF(x + size, bottom)])
            )
        painter.end()

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()  # scrolling the panel must not move the slider under the mouse pointer


class ThresholdRow(QWidget):
    """The row of one threshold: name, slider, and number. chosen(field, value): the user changed the value."""

    chosen = Signal(str, float)

    def __init__(self, threshold: Threshold, help: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.threshold = threshold
        self.setObjectName(f"threshold_{threshold.field}")
        self.setToolTip(tooltip_text(f"{help} ({threshold.field})"))
        self.name = Label(threshold.name, self)
        self.slider = named(MarkedSlider(self), threshold.name)
        self.slider.setRange(0, threshold.steps)
        self.slider.setPageStep(max(1, threshold.steps // 20))
        decimals, unit = 2 if threshold.step < 0.1 else 1, f" {threshold.unit}" if threshold.unit else ""
        self.figure = NumberBox(
            threshold.name, threshold.low, threshold.high, threshold.low, decimals, threshold.step, unit, self
        )
        self.figure.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.figure.setFixedWidth(self.figure.fontMetrics().horizontalAdvance("00.00 m") + 34)
        hbox(self.name, (self.slider, 1), self.figure, on=self, margins=0, spacing=8)
        self.slider.valueChanged.connect(lambda step: self.chosen.emit(threshold.field, threshold.to_value(step)))
        self.figure.valueChanged.connect(lambda value: self.chosen.emit(threshold.field, round(value, 6)))

    def show_value(self, value: float, marks: Mapping[str, float], decides: bool) -> None:
        """Shows a value and its marks. `decides` says whether the current rule uses the threshold."""
        with QSignalBlocker(self.slider), QSignalBlocker(self.figure):
            self.slider.setValue(self.threshold.to_step(value))
            self.figure.setValue(value)
        self.slider.set_marks({name: self.threshold.to_step(v) for name, v in marks.items()})
        moved = decides and self.threshold.to_step(value) != self.threshold.to_step(marks["project"])
        self.name.setFont(type_font(bold=moved))
        self.name.setForegroundRole(QPalette.ColorRole.WindowText if decides else QPalette.ColorRole.PlaceholderText)
        self.slider.setEnabled(decides)
        self.figure.setEnabled(decides)
