"""The frames of the capture: filter them by name, submap, floor, and held-out state, sort them by score, and open one
beside its render."""

from __future__ import annotations

from PySide6.QtCore import (
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QPointF,
    QRect,
    QRectF,
    QSignalBlocker,
    QSize,
    Qt,
    Signal,
)
from PySide6.QtGui import QColor, QFontMetrics, QKeyEvent, QPainter, QPalette, QPixmap
from PySide6.QtWidgets import (
    QComboBox,
    QLineEdit,
    QListView,
    QSizePolicy,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.model import (
    CORRECTED_ROLE,
    COVERAGE_ROLE,
    COVERAGES,
    HELD_OUT_ROLE,
    KINDS,
    MASK_ROLE,
    ORDERS,
    SCORE_ROLE,
    SUBMAP_ROLE,
    FrameFilter,
    FrameModel,
    Thumbnails,
)
from nvsim_app.frames.state import FrameState, Score
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.icons import swatch
from nvsim_app.look.labels import Hint, Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.painting.primitives import paint_label
from nvsim_app.state.document import Document

_KIND = (
    "Held out: frames that no model is trained on, for evaluation. Corrected: frames with a floor mask edited by hand"
)
_ORDER = "Sort by the render quality of held-out frames; frames without a score come last"


class _List(QListView):
    """The list of frames. chosen(QModelIndex): Return was pressed on a row, or it was double-clicked."""

    chosen = Signal(QModelIndex)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setUniformItemSizes(True)
        self.setFrameShape(self.Shape.NoFrame)
        self.setVerticalScrollMode(self.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setMouseTracking(True)  # the row under the mouse pointer is highlighted
        self.doubleClicked.connect(self.chosen)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentIndex().isValid():
            self.chosen.emit(self.currentIndex())
            return
        super().keyPressEvent(event)


class FramePanel(QWidget):
    """The list of frames with its filters. opened(int): a frame was double-clicked, or Return was pressed on it."""

    opened = Signal(int)

    def __init__(
        self,
        document: Document,
        link: FrameLink | None = None,
        state: FrameState | None = None,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._document = document
        link = link or FrameLink(self)
        self.state = state or FrameState(document, link, self)
        self.thumbnails = Thumbnails(document, link, self)
        self.model = FrameModel(document, self.thumbnails, self.state, self)
        self.filter = FrameFilter(document, self)
        self.filter.setSourceModel(self.model)
        self.search = QLineEdit(self)
        self.search.setAccessibleName("Find a frame by name")
        self.search.setPlaceholderText("Find a frame by name")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self.filter.show_name)
        document.projectLeft.connect(self.search.clear)
        self.submap = _choice(self, "Show only frames of this submap, with those that it shares with adjacent submaps")
        self.submap.currentIndexChanged.connect(lambda _: self.filter.show_submap(self.submap.currentData()))
        self.coverage = _choice(self, "Show only frames with this much floor in their mask")
        for words, above, up_to in COVERAGES:
            self.coverage.addItem(words, (above, up_to))
        self.coverage.currentIndexChanged.connect(lambda _: self.filter.show_coverage(*self.coverage.currentData()))
        self.kind = _choice(self, _KIND)
        for words, kind in KINDS:
            self.kind.addItem(words, kind)
        self.kind.currentIndexChanged.connect(lambda _: self.filter.show_kind(self.kind.currentData()))
        self.order = _choice(self, _ORDER)
        for words, by in ORDERS:
            self.order.addItem(words, by)
        self.order.currentIndexChanged.connect(lambda _: self._on_order())
        self.count = Label(self)
        self.count.setForegroundRole(self.count.palette().ColorRole.PlaceholderText)
        self.list = _List(self)
        self.list.setAccessibleName("Frames")
        self.list.setModel(self.filter)
        self.list.setItemDelegate(FrameDelegate(self.list))
        self.hint = Hint(self.list, self._missing).refresh_with(self.list)
        self.list.selectionModel().currentChanged.connect(self._on_current)
        self.list.chosen.connect(lambda index: self.opened.emit(self.filter.mapToSource(index).row()))
        # A filter that hides the selected row makes another row current, which is not the user's choice.
        self._filtering = False
        for begins in (self.filter.layoutAboutToBeChanged, self.filter.rowsAboutToBeRemoved):
            begins.connect(lambda: self._set_filtering(True))
        for ends in (self.filter.layoutChanged, self.filter.rowsRemoved, self.filter.rowsInserted):
            ends.connect(lambda: self._set_filtering(False))
        self.filter.modelReset.connect(self._say_count)
        document.selectionChanged.connect(self._show_selection)
        document.contentsChanged.connect(self._on_contents)
        self.state.changed.connect(self._offer_order)
        first = hbox((self.search, 1), self.count, spacing=4)
        choices = hbox((self.submap, 1), (self.coverage, 1), spacing=4)
        kinds = hbox((self.kind, 1), (self.order, 1), spacing=4)
        vbox(first, choices, kinds, (self.list, 1), on=self, margins=(4, 4, 4, 0), spacing=4)
        self._on_contents(frozenset({"submaps"}))
        self._offer_order()
        self._say_count()

    def _missing(self) -> str:
        if self.filter.rowCount():
            return ""
        all_frames = self.model.rowCount()
        return "No frame matches the filter." if all_frames else "The frames of the capture appear here."

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "submaps" not in parts:
            return
        chosen = self.submap.currentData()
        with QSignalBlocker(self.submap):
            self.submap.clear()
            self.submap.addItem("All submaps", None)
            for submap in self._document.contents.submaps:
                self.submap.addItem(swatch(colors.submap_color(submap.index)), f"Submap {submap.index}", submap.index)
            found = self.submap.findData(chosen)
            self.submap.setCurrentIndex(max(0, found))
        if found < 0 and chosen is not None:
            self.filter.show_submap(None)

    def _on_order(self) -> None:
        self.filter.show_order(self.order.currentData())
        self.list.scrollToTop()

    def _offer_order(self) -> None:
        """Enables sorting by score only if there are scores."""
        measured = self.state.measured
        if not measured:
            self.order.setCurrentIndex(0)
        self.order.setEnabled(measured)
        why = "no held-out frame was measured; Jobs > Evaluate views measures them"
        self.order.setToolTip(tooltip_text(_ORDER + ("" if measured else f"\nUnavailable: {why}.")))

    def _set_filtering(self, filtering: bool) -> None:
        self._filtering = filtering
        if not filtering:
            self._say_count()
            self._show_selection()

    def _say_count(self) -> None:
        shown, all_frames = self.filter.rowCount(), self.model.rowCount()
        self.count.setText(f"{shown:,} of {all_frames:,}" if shown != all_frames else f"{all_frames:,} frames")

    def _on_current(self, current: QModelIndex) -> None:
        if current.isValid() and not self._filtering:
            self._document.select(frame=self.filter.mapToSource(current).row())

    def _show_selection(self) -> None:
        frame = self._document.selection.frame
        if frame is None:
            self.list.setCurrentIndex(QModelIndex())
            return
        self.list.setCurrentIndex(self.filter.mapFromSource(self.model.index(frame)))


def _choice(parent: QWidget, words: str) -> QComboBox:
    box = QComboBox(parent)
    box.setToolTip(tooltip_text(words))
    box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
    return box


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
        words = str(index.data(MASK_ROLE))
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
    paint_label(painter, at, "held out", QColor("#1f2730"), QColor(colors.SELECTED))
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
