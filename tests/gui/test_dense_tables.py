"""A dense table shows all of its columns in a narrow panel, in low rows."""

from __future__ import annotations

from pytestqt.qtbot import QtBot

from nvsim_app.look.table import Column, TableModel, TableView, table


def shown(qtbot: QtBot, dense: bool) -> TableView:
    columns = [
        Column("Name", lambda row: f"threshold {row}"),
        *(Column(f"Value {k}", lambda row: row / 7, "{:.3f}".format, number=True) for k in range(4)),
    ]
    model: TableModel[int] = TableModel(columns, dense=dense)
    view = table(model, None, "Values")
    qtbot.addWidget(view)
    model.setParent(view)
    model.show(range(3))
    view.resize(40 * view.fontMetrics().averageCharWidth() + 60, 200)
    view.show()
    return view


def test_the_column_of_names_takes_the_room_that_the_numbers_leave(qtbot: QtBot) -> None:
    view = shown(qtbot, True)
    header = view.horizontalHeader()
    assert header.length() == view.viewport().width(), "no column is cut, and none is empty"
    for place in range(1, 5):
        assert header.sectionSize(place) >= view.sizeHintForColumn(place)
    assert not view.horizontalScrollBar().isVisible()


def test_rows_are_lower_than_in_other_tables(qtbot: QtBot) -> None:
    dense, other = shown(qtbot, True), shown(qtbot, False)
    assert dense.rowHeight(0) < other.rowHeight(0)
    assert dense.rowHeight(0) >= dense.fontMetrics().height()
