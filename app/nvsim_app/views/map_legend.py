"""The legend of the colors of the graph, below the map, so that it covers no part of the map."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QSizePolicy, QWidget

from nvsim_app.look.boxes import hbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.theme import GRID, type_font

LegendRow = tuple[QPixmap, str]  # the symbol of a group and its words


class MapLegend(QWidget):
    """The title and the groups, from left to right, in lines that take at most a third of the height of the map."""

    def __init__(self, map_view: QWidget) -> None:
        super().__init__(map_view)
        self._map = map_view
        self._shown: tuple[object, ...] = ()
        self._entries: list[QWidget] = []  # the title and the groups
        self._more = 0  # number of groups without an entry
        self._rest = Label("", self)
        self._row = WrappingRow(on=self, spacing=GRID)
        self._row.setContentsMargins(GRID, GRID // 2, GRID, GRID // 2)
        policy = QSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Minimum)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)
        self.setFont(type_font("small"))
        self.hide()

    def show_rows(self, title: str, rows: Sequence[LegendRow], more: int) -> None:
        """Shows these groups, and the number of those that are left out. Without a title, the legend is hidden."""
        shown = title, *((symbol.cacheKey(), words) for symbol, words in rows), more
        if shown != self._shown:
            self._shown, self._more = shown, more
            while self._row.takeAt(0) is not None:
                pass
            for entry in self._entries:
                entry.deleteLater()
            self._entries = [_entry(self, None, title), *(_entry(self, *row) for row in rows)]
            for widget in (*self._entries, self._rest):
                self._row.addWidget(widget)
            self.setAccessibleName(f"Legend: {title}" if title else "")
            self.setAccessibleDescription(", ".join(words for _, words in rows))
            self.fit()
        self.setVisible(bool(title))

    def fit(self) -> None:
        """Shows as many groups as fit. Call it when the map has another size."""
        for count in range(len(self._entries), 0, -1):
            for number, entry in enumerate(self._entries):
                entry.setVisible(number < count)
            rest = self._more + len(self._entries) - count
            self._rest.setText(f"and {rest} more")
            self._rest.setVisible(rest > 0)
            if self._row.heightForWidth(self._map.width()) <= self._map.height() / 3:
                break
        self.updateGeometry()


def _entry(legend: QWidget, symbol: QPixmap | None, words: str) -> QWidget:
    entry = QWidget(legend)
    line = hbox(Label(words, entry), on=entry, margins=0, spacing=GRID // 2)
    if symbol is not None:
        drawn = Label("", entry)
        drawn.setPixmap(symbol)
        line.insertWidget(0, drawn)
    return entry
