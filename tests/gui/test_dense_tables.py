"""A dense table shows all of its columns in a narrow panel, in low rows."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim_app.look.table import Column, TableModel, TableView, table


def shown(qtbot: QtBot, columns: list[Column[int]], dense: bool = False) -> TableView:
    model: TableModel[int] = TableModel(columns, dense=dense)
    view = table(model, None, "Values")
    qtbot.addWidget(view)
    model.setParent(view)
    model.show(range(3))
    view.show()
    return view


def value(title: str, width: int = 0, optional: bool = False) -> Column[int]:
    return Column(title, lambda row: row / 7, "{:.3f}".format, number=True, width=width, optional=optional)


def thresholds(qtbot: QtBot, dense: bool) -> TableView:
    names: Column[int] = Column("Name", lambda row: f"threshold {row}")
    view = shown(qtbot, [names, *(value(f"Value {k}") for k in range(4))], dense)
    view.resize(40 * view.fontMetrics().averageCharWidth() + 60, 200)
    return view


def test_the_column_of_names_takes_the_room_that_the_numbers_leave(qtbot: QtBot) -> None:
    view = thresholds(qtbot, True)
    header = view.horizontalHeader()
    assert header.length() == view.viewport().width(), "no column is cut, and none is empty"
    for place in range(1, 5):
        assert header.sectionSize(place) >= view.sizeHintForColumn(place)
    assert not view.horizontalScrollBar().isVisible()


def test_a_table_with_an_optional_column_comes_to_rest(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether a column is hidden decides whether a scroll bar is shown, and must not depend on it."""
    resized: list[QSize] = []
    resize = TableView.resizeEvent

    def counted(view: TableView, event: QResizeEvent) -> None:
        resized.append(event.size())
        resize(view, event)

    monkeypatch.setattr(TableView, "resizeEvent", counted)
    view = shown(qtbot, [value(f"Value {k}", width=60 * (k % 2), optional=k == 1) for k in range(5)])
    rows = view.horizontalHeader().height() + 3 * view.rowHeight(0)
    for width in range(200, 400, 2):
        for height in (rows - 4, rows, rows + 2, rows + 6, rows + 14):
            resized.clear()
            view.resize(width, height)
            QApplication.processEvents()
            assert len(resized) < 20, f"{width} x {height}"


def test_whether_a_column_is_hidden_does_not_depend_on_whether_it_is_hidden(qtbot: QtBot) -> None:
    titles = ["Value 0", "A title wider than the values", "Value 2", "Value 3"]
    view = shown(qtbot, [value(title, optional=title == titles[1]) for title in titles])
    view.setColumnHidden(1, False)
    needed = sum(view.horizontalHeader().sectionSizeHint(k) for k in range(4))
    hidden = []
    for width in range(needed - 120, needed + 60, 10):
        view.resize(width, 200)
        hidden.append(view.isColumnHidden(1))
        assert hidden[-1] or needed <= width
        for _ in range(2):
            view.fit()
            assert view.isColumnHidden(1) == hidden[-1]
    assert hidden[0] and not hidden[-1]


def test_columns_without_text_leave_their_room_to_others(qtbot: QtBot) -> None:
    texts = [{row: "" for row in range(3)}, {row: "text" for row in range(3)}]
    empty, full = (Column("Title", text.__getitem__, width=80, optional=True) for text in texts)
    view = shown(qtbot, [value("Value", width=80), empty, full])
    view.resize(210, 200)
    assert [view.isColumnHidden(k) for k in range(3)] == [False, True, False]
    texts[0][1] = "now"
    view.fit()
    assert [view.isColumnHidden(k) for k in range(3)] == [False, False, True]


def test_rows_are_lower_than_in_other_tables(qtbot: QtBot) -> None:
    dense, other = thresholds(qtbot, True), thresholds(qtbot, False)
    assert dense.rowHeight(0) < other.rowHeight(0)
    assert dense.rowHeight(0) >= dense.fontMetrics().height()
