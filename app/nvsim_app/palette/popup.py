"""The window of the palette: a line to type in, and the matching entries below it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QModelIndex, QObject, QPersistentModelIndex, QRect, QSize, Qt, Signal
from PySide6.QtGui import QFont, QKeyEvent, QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import (
    QFrame,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import named
from nvsim_app.palette.entries import PaletteEntry

_WIDTH, _ROWS = 560, 11
_ENTRY = Qt.ItemDataRole.UserRole
_STEPS = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1, Qt.Key.Key_PageDown: _ROWS, Qt.Key.Key_PageUp: -_ROWS}
_OWN = (*_STEPS, Qt.Key.Key_Escape, Qt.Key.Key_Return, Qt.Key.Key_Enter)


class _Rows(QStyledItemDelegate):
    """Draws the title with the typed letters in bold, then the menu or reason, and the shortcut on the right."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, option.fontMetrics.height() + 10)

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        entry: PaletteEntry = index.data(_ENTRY)
        painter.save()
        palette = option.palette
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        if chosen:
            painter.fillRect(option.rect, palette.highlight())
        box = option.rect.adjusted(12, 0, -12, 0)
        ink = palette.color(QPalette.ColorRole.HighlightedText if chosen else QPalette.ColorRole.Text)
        quiet = palette.color(QPalette.ColorRole.HighlightedText if chosen else QPalette.ColorRole.PlaceholderText)
        middle = Qt.AlignmentFlag.AlignVCenter
        painter.setPen(quiet)
        if entry.shortcut:
            painter.drawText(box, middle | Qt.AlignmentFlag.AlignRight, entry.shortcut)
            box.setRight(box.right() - option.fontMetrics.horizontalAdvance(entry.shortcut) - 16)
        painter.setPen(quiet if entry.reason else ink)
        used = self._title(painter, entry, box, option.font)
        painter.setPen(quiet)
        painter.setFont(option.font)
        rest = QRect(box.left() + used + 12, box.top(), max(0, box.width() - used - 12), box.height())
        words = f"unavailable: {entry.reason}" if entry.reason else entry.place
        elided = painter.fontMetrics().elidedText(plain(words), Qt.TextElideMode.ElideRight, rest.width())
        painter.drawText(rest, middle | Qt.AlignmentFlag.AlignLeft, elided)
        painter.restore()

    def _title(self, painter: QPainter, entry: PaletteEntry, box: QRect, font: QFont) -> int:
        """Draws the title and returns its width in pixels."""
        bold = type_font(bold=True)
        marks, x = set(entry.marks), box.left()
        for i, letter in enumerate(entry.title):
            painter.setFont(bold if i in marks else font)
            width = painter.fontMetrics().horizontalAdvance(letter)
            if x + width > box.right():
                break
            painter.drawText(QRect(x, box.top(), width + 2, box.height()), Qt.AlignmentFlag.AlignVCenter, letter)
            x += width
        return x - box.left()


class PaletteView(QFrame):
    """The palette over the window. `offer` returns the entries for a text. ran(Entry): an entry was executed."""

    ran = Signal(object)

    def __init__(self, offer: Callable[[str], list[PaletteEntry]], parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("commandPalette")
        self.setAutoFillBackground(True)
        self._offer = offer
        self._before: QWidget | None = None
        self.line = QLineEdit(
            self, placeholderText="Type a command, a viewpoint or a frame", clearButtonEnabled=True, frame=False
        )
        self.line.setAccessibleName("Command, viewpoint or frame")
        self.line.setMinimumHeight(34)
        self.line.setTextMargins(8, 0, 4, 0)
        self.line.textChanged.connect(self._fill)
        self.line.installEventFilter(self)
        self.list = named(QListWidget(self), "Matches")
        self.list.setItemDelegate(_Rows(self.list))
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.itemClicked.connect(self._run)
        self.nothing = Label("Nothing matches.", self)
        self.nothing.setContentsMargins(8, 8, 8, 8)
        vbox(self.line, self.nothing, self.list, on=self, margins=4, spacing=0)
        parent.installEventFilter(self)
        self.hide()

    def open(self) -> None:
        """Shows the empty palette, or closes it if it is open. On closing, the keyboard focus returns."""
        if self.isVisible():
            self.close()
            return
        self._before = self.window().focusWidget()
        self.line.clear()
        self._fill("")
        self.show()
        self.raise_()
        self._place()
        self.line.setFocus()

    def close(self) -> bool:
        self.hide()
        if self._before is not None:
            self._before.setFocus()
            self._before = None
        return True

    def _fill(self, typed: str) -> None:
        self.list.clear()
        for entry in self._offer(typed):
            item = QListWidgetItem()
            item.setToolTip(tooltip_text(f"Unavailable: {entry.reason}.") if entry.reason else "")
            item.setData(_ENTRY, entry)
            item.setData(Qt.ItemDataRole.AccessibleTextRole, entry.title)
            self.list.addItem(item)
        self.list.setCurrentRow(0)
        self.nothing.setVisible(self.list.count() == 0)
        self._place()

    def _run(self, item: QListWidgetItem | None) -> None:
        if item is None:
            return
        entry: PaletteEntry = item.data(_ENTRY)
        if entry.reason:
            return  # the row shows the reason
        self.close()
        entry.run()
        self.ran.emit(entry)

    def _place(self) -> None:
        parent = self.parentWidget()
        assert parent is not None  # given at construction
        width = min(_WIDTH, parent.width() - 40)
        row = self.list.sizeHintForRow(0) if self.list.count() else 0
        self.list.setFixedHeight(row * min(_ROWS, self.list.count()))
        self.setFixedWidth(width)
        self.adjustSize()
        self.move((parent.width() - self.width()) // 2, min(80, max(20, parent.height() // 8)))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.parentWidget():
            if event.type() == QEvent.Type.Resize and self.isVisible():
                self._place()
            return super().eventFilter(watched, event)
        if (
            event.type() == QEvent.Type.FocusOut
            and self.isVisible()
            and not self.isAncestorOf(self.window().focusWidget())
        ):
            self.hide()
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and event.key() in _OWN:
            event.accept()  # while the palette is open, these keys run no commands
            return True
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent):
            if event.key() == Qt.Key.Key_Escape:
                self.close()
                return True
            if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                self._run(self.list.currentItem())
                return True
            move = _STEPS.get(Qt.Key(event.key()))
            if move is not None and self.list.count():
                row = self.list.currentRow() + move
                row = row % self.list.count() if abs(move) == 1 else min(max(row, 0), self.list.count() - 1)
                self.list.setCurrentRow(row)
                return True
        return super().eventFilter(watched, event)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setPen(self.palette().color(QPalette.ColorRole.Accent))
        painter.setBrush(self.palette().base())
        painter.drawRoundedRect(self.rect().adjusted(0, 0, -1, -1), 5, 5)
        painter.end()
