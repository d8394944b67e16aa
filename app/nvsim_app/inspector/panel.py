"""The inspector panel: the panorama, the list of directions, and the measured values of one direction as bars."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QModelIndex, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QButtonGroup, QCheckBox, QFrame, QScrollArea, QSizePolicy, QWidget

from nvsim.mapping.explanation.explain import CriterionResult, Explanation
from nvsim.plain_text import capitalized
from nvsim_app.inspector.panorama_view import PanoramaView
from nvsim_app.inspector.panoramas import Panoramas
from nvsim_app.inspector.state import Inspection
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.icons import swatch
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.table import Column, TableModel, TableView, table
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import named, tool_button
from nvsim_app.state.directions import Direction, two_decimals

_ROW = 21  # pixels
_LEAST = 6  # minimum number of rows: the number of default criteria


class MeasureBars(QWidget):
    """One line for each criterion: name, bar from 0 to 1 with a mark at the threshold, value, and threshold."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("measureBars")
        self._measures: tuple[CriterionResult, ...] = ()
        self._failed: CriterionResult | None = None
        self._most = 1
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_explanation(self, explanation: Explanation | None) -> None:
        self._measures = () if explanation is None else explanation.measures
        self._failed = None if explanation is None else explanation.failed
        self.setAccessibleDescription("; ".join(_words(m) for m in self._measures))
        self.updateGeometry()
        self.update()

    def set_most_columns(self, most: int) -> None:
        """Arranges the lines in up to `most` columns, as many as have room for their texts."""
        if most != self._most:
            self._most = most
            self.updateGeometry()
            self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.updateGeometry()
        super().resizeEvent(event)

    @property
    def _columns(self) -> int:
        names, figures = self._widths()
        return max(1, min(self._most, int(self.width() / (names + figures + _SHORTEST + 8))))

    def sizeHint(self) -> QSize:
        return QSize(300, self._rows * _ROW + 4)

    def minimumSizeHint(self) -> QSize:
        return QSize(200, self._rows * _ROW + 4)

    @property
    def _rows(self) -> int:
        """The number of lines of a column."""
        return -(-max(_LEAST, len(self._measures)) // self._columns)

    def _widths(self) -> tuple[int, int]:
        """Pixels of the names and of the figures."""
        metrics = self.fontMetrics()
        names = max((metrics.horizontalAdvance(_name(m)) for m in self._measures), default=0) + 10
        return names, metrics.horizontalAdvance("0.00 > 0.00") + 6

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        palette = self.palette()
        ink, quiet = palette.text().color(), palette.placeholderText().color()
        names, figures = self._widths()
        width = self.width() / self._columns
        bar = max(_SHORTEST, width - names - figures - 8.0)
        for i, measure in enumerate(self._measures):
            column, row = divmod(i, self._rows)
            painter.resetTransform()
            painter.translate(column * width, 0.0)
            top = 2 + row * _ROW
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
            text = f"{two_decimals(measure.value)} {measure.relation} {two_decimals(measure.limit)}"
            right = QRectF(names + bar + 6, top, figures, _ROW)
            painter.drawText(right, line | Qt.AlignmentFlag.AlignRight, text)
        painter.end()


def _name(measure: CriterionResult) -> str:
    return capitalized(measure.name)


def _words(measure: CriterionResult) -> str:
    state = "passes" if measure.passes else "fails"
    return f"{measure.name} {two_decimals(measure.value)}, threshold {two_decimals(measure.limit)}, {state}"


def _decision_color(direction: Direction) -> str:
    return colors.text("blocked" if not direction.open else "open" if direction.joined else "warning")


_COLUMNS: tuple[Column[Direction], ...] = (
    Column("Direction", lambda direction: direction.place if direction.lattice else f"{direction.place} ↝",
           icon=lambda direction: swatch(colors.OPEN if direction.open else colors.BLOCKED)),
    Column("Decision", lambda direction: direction.outcome_label, ink=_decision_color),
    Column("Leads to", lambda direction: direction.name if direction.neighbor else "",
           about=lambda direction: f"Double-click to go to {direction.neighbor}" if direction.neighbor else "",
           optional=True),
)  # fmt: skip
CHANNELS = {"rgb": "Color", "alpha": "Alpha", "normal": "Normals"}
_LIST_ROWS = 5  # minimum height of the list, in rows with its header
_SHORTEST = 20.0  # length of a bar, in pixels, at least
_LOW = 460  # height of the panel, in pixels, below which the bars are in two columns, if there is room
_WIDE = 1.7  # aspect ratio of the panel above which the list is beside the panorama


class InspectorPanel(QScrollArea):
    """Shows the directions of the inspected viewpoint. chosen(Direction): the user wants to go to the end of this
    direction."""

    chosen = Signal(object)

    def __init__(self, inspection: Inspection, panoramas: Panoramas) -> None:
        super().__init__(widgetResizable=True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._inspection = inspection
        content = QWidget(self)
        self.view = PanoramaView(inspection, panoramas, content)
        self.view.chosen.connect(self.chosen)
        self.sentence = Label(
            content, wordWrap=True, selectable=True, alignment=Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft
        )
        self.sentence.setMinimumHeight(2 * self.sentence.fontMetrics().lineSpacing())
        self.bars = MeasureBars(content)
        self.model: TableModel[Direction] = TableModel(
            _COLUMNS, self, lambda direction: direction.key, lambda direction: direction.sentence, dense=True
        )
        self.list = self._list(content)
        beside = vbox(self.sentence, (self.list, 1), self.bars, spacing=8)
        self._halves = QBoxLayout(QBoxLayout.Direction.TopToBottom)
        self._halves.setSpacing(8)
        self._halves.addWidget(self.view, 3)
        self._halves.addLayout(beside, 2)
        vbox(self._head(content), (self._halves, 1), on=content, margins=8, spacing=8)
        self.setWidget(content)
        inspection.changed.connect(self._fill)
        inspection.pointed.connect(self._show_pointed)
        self._fill()

    def _head(self, parent: QWidget) -> WrappingRow:
        row = WrappingRow()
        self.title = Label(parent, font=type_font(bold=True))
        self.title.setMinimumWidth(self.title.fontMetrics().horizontalAdvance("dddddd") + 6)
        row.addWidget(self.title)
        self.channels = QButtonGroup(self)
        for i, (channel, text) in enumerate(CHANNELS.items()):
            tip = f"Show {text.lower()} in the panorama"
            button = tool_button(
                text, parent, tip=tip, checkable=True, autoRaise=True, objectName=f"panorama_{channel}"
            )
            button.setChecked(channel == "rgb")
            button.setProperty("channel", channel)
            self.channels.addButton(button, i)
            row.addWidget(button)
        self.channels.buttonClicked.connect(lambda button: self.view.set_channel(button.property("channel")))
        self.regions = named(QCheckBox("Regions", parent), tip="Show the regions of interest of the eight directions")
        self.regions.setChecked(True)
        self.regions.toggled.connect(self.view.show_regions)
        row.addWidget(self.regions)
        return row

    def _list(self, parent: QWidget) -> TableView:
        view = table(self.model, parent, "Directions")
        view.setObjectName("directions")
        view.setMouseTracking(True)
        view.setMinimumHeight(_LIST_ROWS * (view.fontMetrics().height() + 5))
        view.entered.connect(self._on_current)
        view.selectionModel().currentRowChanged.connect(self._on_current)
        view.doubleClicked.connect(lambda index: self.chosen.emit(self.model.row(index.row())))
        return view

    def set_channel(self, channel: str) -> None:
        """Shows one of CHANNELS."""
        for button in self.channels.buttons():
            if button.property("channel") == channel:
                button.setChecked(True)
                self.view.set_channel(channel)

    def enable_channels(self, drawn: bool) -> None:
        """Enables the available channels: models render all of them, images beside a file have only colors."""
        for button in self.channels.buttons():
            channel = str(button.property("channel"))
            button.setEnabled(drawn or channel == "rgb")
            shown = f"Show {CHANNELS[channel].lower()} in the panorama"
            button.setToolTip(
                tooltip_text(shown) if button.isEnabled() else "The images of a graph file have colors only"
            )

    def _on_current(self, index: QModelIndex) -> None:
        if index.isValid():
            self._inspection.point(self.model.row(index.row()))

    def _fill(self) -> None:
        id = self._inspection.viewpoint
        self.title.setText(self._inspection.name_of(id) if id else "")
        self.title.setToolTip(tooltip_text(f"Viewpoint {id}" if id else ""))
        self.model.show(self._inspection.directions)
        self._show_pointed()

    def _show_pointed(self) -> None:
        current = self._inspection.current
        keys = [direction.key for direction in self.model.rows]
        row = keys.index(current.key) if current is not None and current.key in keys else -1
        self.list.setCurrentIndex(self.model.index(row, 0))
        self.bars.show_explanation(None if current is None else current.explanation)
        self.sentence.setText(self._words(current))

    def _words(self, current: Direction | None) -> str:
        if current is not None:
            return current.sentence
        found = [d for d in self._inspection.directions if d.lattice]
        if self._inspection.viewpoint is None:
            return "Select a viewpoint to see its measurements."
        if not found:
            return "This viewpoint has no stored evidence: it was added by a user or a file, or it was moved."
        free = sum(d.open for d in found)
        return f"{free} of {len(found)} directions pass the thresholds. Point at one to see its values."

    def changeEvent(self, event: QEvent) -> None:
        """Updates the colors after a change of the theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_halves"):
            self._fill()

    def resizeEvent(self, event: QResizeEvent) -> None:
        size = self.viewport().size()
        wide = size.width() > _WIDE * size.height()
        way = QBoxLayout.Direction.LeftToRight if wide else QBoxLayout.Direction.TopToBottom
        self._halves.setDirection(way)
        self.bars.set_most_columns(2 if size.height() < _LOW and not wide else 1)
        super().resizeEvent(event)
