"""The list of recent projects with thumbnail, name, and path. Missing folders are marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRect, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QKeyEvent, QPainter, QPainterPath, QPixmap
from PySide6.QtWidgets import (
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from app.look import colors
from app.look.icons import icon
from app.look.metrics import type_font
from app.look.plain_text import plain, tip
from app.state.recent_child import Looked

_THUMBNAIL = QSize(96, 64)
_GAP = 8
_PATH, _GONE = Qt.ItemDataRole.UserRole, Qt.ItemDataRole.UserRole + 1


class _Row(QStyledItemDelegate):
    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, _THUMBNAIL.height() + 2 * _GAP)

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        style, widget = option.widget.style(), option.widget
        style.drawPrimitive(QStyle.PrimitiveElement.PE_PanelItemViewItem, option, painter, widget)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        gone, path = bool(index.data(_GONE)), Path(str(index.data(_PATH)))
        box = QRect(option.rect.topLeft(), _THUMBNAIL).translated(_GAP, _GAP)
        self._thumbnail(painter, box, index.data(Qt.ItemDataRole.DecorationRole), option, gone)
        words = option.rect.adjusted(_THUMBNAIL.width() + 2 * _GAP + 4, _GAP, -_GAP, -_GAP)
        palette = option.palette
        ink = palette.highlightedText().color() if chosen else palette.text().color()
        quiet = ink if chosen else palette.placeholderText().color()
        bold = type_font(bold=True)
        rows = [(plain(path.name), bold, quiet if gone else ink), (plain(path.parent, 1000), option.font, quiet)]
        if gone:
            warning = ink if chosen else QColor(colors.text("warning"))
            rows.append(("Folder not found. Press Del to remove it.", option.font, warning))
        height = option.fontMetrics.height() + 2
        top = words.top() + max(0, (words.height() - height * len(rows)) // 2)
        for text, font, color in rows:
            painter.setFont(font)
            painter.setPen(color)
            elided = painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideMiddle, words.width())
            painter.drawText(QRect(words.left(), top, words.width(), height), Qt.AlignmentFlag.AlignVCenter, elided)
            top += height
        painter.restore()

    def _thumbnail(
        self, painter: QPainter, box: QRect, image: object, option: QStyleOptionViewItem, gone: bool
    ) -> None:
        shape = QPainterPath()
        shape.addRoundedRect(QRectF(box), 4, 4)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.fillPath(shape, option.palette.midlight())
        pixmap = image.pixmap(image.availableSizes()[0]) if isinstance(image, QIcon) and not image.isNull() else None
        if pixmap is None:
            icon("nvsim", option.palette).paint(
                painter, box.adjusted(20, 16, -20, -16), mode=QIcon.Mode.Disabled if gone else QIcon.Mode.Normal
            )
            return
        painter.setClipPath(shape)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.setOpacity(0.4 if gone else 1.0)
        # The largest central part with the aspect ratio of the box.
        share = min(pixmap.width() / box.width(), pixmap.height() / box.height())
        part = QRectF(0, 0, box.width() * share, box.height() * share)
        part.moveCenter(QRectF(pixmap.rect()).center())
        painter.drawPixmap(QRectF(box), pixmap, part)
        painter.setOpacity(1.0)
        painter.setClipping(False)


class RecentList(QListWidget):
    """Recent projects. chosen(Path): Enter or a double-click. forgotten(Path): Del."""

    chosen = Signal(object)
    forgotten = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setItemDelegate(_Row(self))
        self.setUniformItemSizes(True)
        self.setAccessibleName("Recent projects")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.itemDoubleClicked.connect(self._choose)

    def show_projects(self, paths: Sequence[Path]) -> None:
        """Replaces the list. Keeps the thumbnails and states of projects that stay."""
        known = {self._path(item): item for item in self._items()}
        current = self.current
        kept = {path: (known[path].icon(), known[path].data(_GONE)) for path in paths if path in known}
        self.clear()
        for path in paths:
            item = QListWidgetItem(plain(path.name), self)
            item.setData(_PATH, str(path))
            item.setToolTip(tip(path))
            if path in kept:
                item.setIcon(kept[path][0])
                item.setData(_GONE, kept[path][1])
        if self.count():
            self.setCurrentRow(list(paths).index(current) if current is not None and current in paths else 0)

    def show_looks(self, looked: Mapping[Path, Looked]) -> None:
        """Shows the states and thumbnails of the projects."""
        for item in self._items():
            found = looked.get(self._path(item))
            if found is None:
                continue
            item.setData(_GONE, not found.there)
            pixmap = QPixmap()
            if found.picture and pixmap.loadFromData(found.picture):
                item.setIcon(QIcon(pixmap))

    @property
    def current(self) -> Path | None:
        item = self.currentItem()
        return None if item is None else self._path(item)

    @property
    def gone(self) -> tuple[Path, ...]:
        """The projects whose folder is known to be missing."""
        return tuple(self._path(item) for item in self._items() if item.data(_GONE))

    def forget_current(self) -> None:
        if self.current is not None:
            self.forgotten.emit(self.current)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentItem() is not None:
            self._choose(self.currentItem())
        elif event.key() in (Qt.Key.Key_Delete, Qt.Key.Key_Backspace):
            self.forget_current()
        else:
            super().keyPressEvent(event)

    def _choose(self, item: QListWidgetItem) -> None:
        self.chosen.emit(self._path(item))

    def _path(self, item: QListWidgetItem) -> Path:
        return Path(str(item.data(_PATH)))

    def _items(self) -> list[QListWidgetItem]:
        return [self.item(row) for row in range(self.count())]
