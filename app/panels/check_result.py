"""The findings of the data check, one row per kind, with their places and consequences."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRect, QSize, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QHeaderView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from app.jobs.check import CheckResult
from app.look import colors
from app.look.plain_text import lines, plain, tip
from nvsim.capture.findings import Kind

_COLORS = {"error": "blocked", "warning": "warning", "note": "quiet"}
_SIGNS = {"error": "✗ ", "warning": "⚠ ", "note": ""}
_WORDS = {"error": "must be fixed", "warning": "reduces quality", "note": "for information"}
_MOST_PLACES = 200


class _Wrapped(QStyledItemDelegate):
    """Rows as high as their wrapped text. The default size hint of a tree view is one line."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        tree = self.parent()
        assert isinstance(tree, QTreeWidget)
        depth = 2 if index.parent().isValid() else 1
        indent = depth * tree.indentation() if index.column() == 0 else 0
        width = max(40, tree.columnWidth(index.column()) - indent - 8)
        box = QRect(0, 0, width, 10_000)
        words = option.fontMetrics.boundingRect(box, Qt.TextFlag.TextWordWrap, str(index.data() or " "))
        return QSize(width, words.height() + 7)


class FindingTree(QTreeWidget):
    """One row for each kind of finding. `kinds` are the displayed kinds."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kinds: tuple[Kind, ...] = ()
        self.setHeaderLabels(["Problem", "Where", "Consequence"])
        self.header().setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        for column, width in enumerate((260, 130, 220)):
            self.header().resizeSection(column, width)
        self.header().sectionResized.connect(self.scheduleDelayedItemsLayout)
        self.setItemDelegate(_Wrapped(self))
        self.setWordWrap(True)
        self.setAlternatingRowColors(True)

    @property
    def chosen(self) -> Kind | None:
        """The kind of the selected row or place; None without a selection."""
        items = self.selectedItems()
        if not items:
            return None
        item = items[0].parent() or items[0]
        return self.kinds[self.indexOfTopLevelItem(item)]

    def show_result(self, result: CheckResult) -> None:
        """Replaces the displayed findings."""
        self.clear()
        self.kinds = result.kinds
        for kind in result.kinds:
            many = len(kind.places) > 1
            message = kind.message[:1].upper() + kind.message[1:]
            where = f"{len(kind.places)} places" if many else kind.places[0]
            shown = f"{_SIGNS[kind.severity]}{lines(message)}"
            item = QTreeWidgetItem([shown, plain(where), lines(kind.consequence)])
            item.setForeground(0, QColor(colors.text(_COLORS.get(kind.severity, "quiet"))))
            tips = (f"{message} ({_WORDS[kind.severity]})", "\n".join(kind.places[:20]), kind.consequence)
            for column, words in enumerate(tips):
                item.setToolTip(column, tip(words))
            for place in kind.places[:_MOST_PLACES] if many else ():
                item.addChild(QTreeWidgetItem(["", plain(place), ""]))
            self.addTopLevelItem(item)
