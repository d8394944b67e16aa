"""The labels of the window: plain text or trusted markup, values to copy, hints in empty lists, and rows that wrap. A
plain QLabel interprets any text as markup."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, QModelIndex, QObject, QPersistentModelIndex, QPoint, QRect, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import (
    QAbstractItemView,
    QAbstractScrollArea,
    QApplication,
    QLabel,
    QLayout,
    QLayoutItem,
    QLineEdit,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTreeView,
    QWidget,
)

from nvsim_app.look import colors
from nvsim_app.look.plain_text import in_window, lines, plain, tooltip_text, with_break_points

_WIDEST = 400  # maximum of the minimum width of a label, pixels
_TAG = re.compile(r"<\s*/?\s*([^\s/>]*)")
_OUR_TAGS = frozenset({"b", "br", "span", "table", "td", "tr"})


class Label(QLabel):
    """A label that shows plain text. Its minimum width is limited, so that a long word does not widen the window."""

    def __init__(
        self,
        words: str | QWidget | None = "",
        parent: QWidget | None = None,
        quiet: bool = False,
        selectable: bool = False,
        **options: Any,  # Any: Qt properties of different types
    ) -> None:
        """The arguments of QLabel: text and parent, or only the parent.

        A `quiet` label has the color of placeholders. The mouse can select the text of a `selectable` label.
        """
        own = words if isinstance(words, str) else ""
        super().__init__(parent if isinstance(words, str) else words, **options)
        self.setTextFormat(Qt.TextFormat.PlainText)
        if quiet:
            self.setForegroundRole(QPalette.ColorRole.PlaceholderText)
        if selectable:
            self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        if own:
            self.setText(own)

    def setText(self, words: str) -> None:
        super().setText(with_break_points(lines(in_window(words))))

    def minimumSizeHint(self) -> QSize:
        hint = super().minimumSizeHint()
        return QSize(min(hint.width(), _WIDEST), hint.height())


class InkLabel(Label):
    """A label whose color has a meaning: `ink` is a key in `colors.TEXTS`, "" for the normal text color."""

    def __init__(self, ink: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.set_ink(ink)

    def set_ink(self, ink: str) -> None:
        self._ink = ink
        self._apply_palette()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_ink"):
            self._apply_palette()
        super().changeEvent(event)

    def _apply_palette(self) -> None:
        wanted = QColor(colors.text(self._ink)) if self._ink else QApplication.palette().windowText().color()
        if self.palette().windowText().color() != wanted:
            palette = QPalette()  # the other colors remain those of the theme
            palette.setColor(palette.ColorRole.WindowText, wanted)
            self.setPalette(palette)


class MarkedLabel(Label):
    """A label with trusted HTML. Text from outside must pass through `escape_html`. If the HTML contains unexpected
    tags, everything is shown as plain text."""

    def setText(self, words: str) -> None:
        ours = _OUR_TAGS.issuperset(_TAG.findall(words)) and "url(" not in words and "background" not in words
        self.setTextFormat(Qt.TextFormat.RichText if ours else Qt.TextFormat.PlainText)
        QLabel.setText(self, words if ours else with_break_points(lines(words)))


class Value(QLineEdit):
    """A read-only text field. The whole value can be copied, even if it is wider than the field."""

    def __init__(self, value: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setFrame(False)
        self.setTextMargins(-2, 0, 0, 0)
        palette = QPalette()  # the other colors remain those of the theme
        palette.setColor(palette.ColorRole.Base, Qt.GlobalColor.transparent)
        self.setPalette(palette)
        self.show_value(value)

    def show_value(self, value: str) -> None:
        self.setText(plain(value))
        self.setToolTip(tooltip_text(value))
        self.setCursorPosition(0)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Ends a value that is wider than the field in "…", until the field has the keyboard focus."""
        shown = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width() - 2)
        if self.hasFocus() or shown == self.text():
            super().paintEvent(event)
            return
        painter = QPainter(self)
        painter.setPen(self.palette().color(QPalette.ColorRole.Text))
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, shown)


_MARGIN = 14  # pixels


class Hint(Label):
    """A label over the viewport of `area` that ignores the mouse.

    words  returns the current text, "" if the area is not empty
    """

    def __init__(self, area: QAbstractScrollArea, words: Callable[[], str]) -> None:
        super().__init__(area.viewport(), quiet=True, wordWrap=True, alignment=Qt.AlignmentFlag.AlignCenter)
        self._under = area.viewport()
        self._words = words
        self.setObjectName("hint")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        area.viewport().installEventFilter(self)
        self.refresh()

    def refresh_with(self, view: QAbstractItemView) -> Hint:
        """Refreshes whenever the rows of `view` change."""
        model = view.model()
        for changed in (model.modelReset, model.rowsInserted, model.rowsRemoved, model.layoutChanged):
            changed.connect(self.refresh)
        return self

    def refresh(self) -> None:
        words = self._words()
        self.setText(words)
        self.setVisible(bool(words))
        self._fit()

    def _fit(self) -> None:
        self.setGeometry(self._under.rect().adjusted(_MARGIN, 4, -_MARGIN, -4))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self._fit()
        return super().eventFilter(watched, event)


class WrappingRow(QLayout):
    """A layout that places widgets from left to right, and wraps to the next line. Hidden widgets take no space."""

    def __init__(self, *widgets: QWidget, on: QWidget | None = None, spacing: int = 4) -> None:
        super().__init__(on)
        self._items: list[QLayoutItem] = []
        self.setSpacing(spacing)
        for widget in widgets:
            self.addWidget(widget)

    def addItem(self, item: QLayoutItem) -> None:
        self._items.append(item)

    def count(self) -> int:
        return len(self._items)

    def itemAt(self, index: int) -> QLayoutItem | None:
        return self._items[index] if 0 <= index < len(self._items) else None

    def takeAt(self, index: int) -> QLayoutItem | None:
        return self._items.pop(index) if 0 <= index < len(self._items) else None

    def expandingDirections(self) -> Qt.Orientation:
        return Qt.Orientation(0)

    def hasHeightForWidth(self) -> bool:
        return True

    def heightForWidth(self, width: int) -> int:
        return self._placed(QRect(0, 0, width, 0), place=False)

    def setGeometry(self, rect: QRect) -> None:
        super().setGeometry(rect)
        self._placed(rect, place=True)

    def sizeHint(self) -> QSize:
        margins = self.contentsMargins()
        sizes = [item.sizeHint() for item in self._items if not item.isEmpty()]
        width = sum(size.width() + self.spacing() for size in sizes) + margins.left() + margins.right()
        height = max((size.height() for size in sizes), default=0) + margins.top() + margins.bottom()
        return QSize(width, height)

    def minimumSize(self) -> QSize:
        margins = self.contentsMargins()
        widest = QSize(0, 0)
        for item in self._items:
            if not item.isEmpty():
                widest = widest.expandedTo(item.minimumSize())
        return widest + QSize(margins.left() + margins.right(), margins.top() + margins.bottom())

    def _placed(self, rect: QRect, place: bool) -> int:
        """The required height; with `place`, also moves the widgets."""
        margins = self.contentsMargins()
        inner = rect.adjusted(margins.left(), margins.top(), -margins.right(), -margins.bottom())
        x, y, line = inner.x(), inner.y(), 0
        for item in self._items:
            if item.isEmpty():
                continue
            size = item.sizeHint().expandedTo(item.minimumSize())
            if x > inner.x() and x + size.width() > inner.right() + 1:
                x, y, line = inner.x(), y + line + self.spacing(), 0
            if place:
                item.setGeometry(QRect(QPoint(x, y), size))
            x, line = x + size.width() + self.spacing(), max(line, size.height())
        return y + line - rect.y() + margins.bottom()


class WrappedRows(QStyledItemDelegate):
    """Rows of a tree as high as their wrapped text. The default size hint of a tree view is one line."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        tree = self.parent()
        assert isinstance(tree, QTreeView)
        depth = 2 if index.parent().isValid() else 1
        indent = depth * tree.indentation() if index.column() == 0 else 0
        width = max(40, tree.columnWidth(index.column()) - indent - 8)
        box = QRect(0, 0, width, 10_000)
        words = option.fontMetrics.boundingRect(box, Qt.TextFlag.TextWordWrap, str(index.data() or " "))
        return QSize(width, words.height() + 7)
