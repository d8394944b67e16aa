"""The findings of the data check, one row per kind, with their places and consequences."""

from __future__ import annotations

from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHeaderView, QTreeWidget, QTreeWidgetItem, QWidget

from app.jobs.check import CheckResult
from app.look import colors
from app.look.plain_text import lines, plain, tip
from app.look.wording import in_window
from app.look.wrapping import WrappedRows
from nvsim.capture.findings import Kind

_COLORS = {"error": "blocked", "warning": "warning", "note": "quiet"}
_SIGNS = {"error": "✗ ", "warning": "⚠ ", "note": ""}
_WORDS = {"error": "must be fixed", "warning": "reduces quality", "note": "for information"}
_MOST_PLACES = 200


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
        self.setItemDelegate(WrappedRows(self))
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
            shown = f"{_SIGNS[kind.severity]}{lines(in_window(message))}"
            item = QTreeWidgetItem([shown, plain(where), lines(in_window(kind.consequence))])
            item.setForeground(0, QColor(colors.text(_COLORS.get(kind.severity, "quiet"))))
            tips = (f"{message} ({_WORDS[kind.severity]})", "\n".join(kind.places[:20]), kind.consequence)
            for column, words in enumerate(tips):
                item.setToolTip(column, tip(words))
            for place in kind.places[:_MOST_PLACES] if many else ():
                item.addChild(QTreeWidgetItem(["", plain(place), ""]))
            self.addTopLevelItem(item)
