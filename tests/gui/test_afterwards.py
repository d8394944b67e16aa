"""Panels update in slices when they are visible, and outdated work is canceled."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QWidget
from pytestqt.modeltest import ModelTester
from pytestqt.qtbot import QtBot

from nvsim.graph.quantities import quantity
from nvsim_app.layers.labels import short_ids
from nvsim_app.look.table import TableModel
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.panels.history import HistoryPanel
from nvsim_app.panels.tables import edge_columns
from nvsim_app.state.document import Document


@pytest.fixture
def panel(qtbot: QtBot) -> QWidget:
    made = QWidget()
    qtbot.addWidget(made)
    made.show()
    return made


def test_a_long_renewal_is_done_over_several_turns_and_given_up_when_marked_again(panel: QWidget, qtbot: QtBot) -> None:
    done: list[str] = []
    rounds = iter(("first", "second"))

    def renew() -> Iterator[None]:
        name = next(rounds)
        for _ in range(4):
            time.sleep(0.008)  # longer than a slice
            done.append(name)
            yield
        done.append(f"{name} ended")

    soon = DeferredRefresh(panel, renew, 1)
    qtbot.waitUntil(lambda: soon.in_sight, timeout=20_000)
    soon.mark()
    qtbot.waitUntil(lambda: bool(done), timeout=20_000)
    assert "first ended" not in done
    soon.mark()
    qtbot.waitUntil(lambda: "second ended" in done, timeout=20_000)
    assert "first ended" not in done and done.count("second") == 4


def test_a_hidden_panel_waits_until_it_is_seen(panel: QWidget, qtbot: QtBot) -> None:
    done: list[int] = []
    soon = DeferredRefresh(panel, lambda: done.append(1), 1)
    panel.hide()
    soon.mark()
    qtbot.wait(30)
    assert not done
    panel.show()
    qtbot.waitUntil(lambda: done == [1], timeout=20_000)


def test_history_rows_come_and_go_at_the_end(document: Document, qtmodeltester: ModelTester) -> None:
    panel = HistoryPanel(document)
    model = panel.model
    qtmodeltester.check(model)
    resets: list[int] = []
    model.modelReset.connect(lambda: resets.append(1))
    editing, ids = document.editing, document.graph_arrays.ids

    def texts() -> list[str]:
        return [model.index(row, 0).data() for row in range(model.rowCount())]

    def move(row: int, name: str = "shift_viewpoints") -> None:
        assert editing.run(name, {"ids": [ids[row]], "by": [0.3, 0.0, 0.0]})

    for row in (1, 2, 3):
        move(row)
    before = texts()
    assert len(before) == 4
    editing.undo()
    editing.undo()
    assert texts() == before  # they can be done again
    editing.run("mark_reviewed", {"viewpoints": [ids[0]]})
    assert len(texts()) == 3 and texts()[:2] == before[:2] and texts()[2] != before[2]
    assert [short_ids(document.graph, step.text) for step in editing.history.steps] == texts() and not resets


def test_edges_sort_by_their_evidence_and_length(document: Document) -> None:
    graph = document.graph
    columns = edge_columns(graph, document.evidence)
    model = TableModel(columns)
    for column, name in ((2, "length"), (3, "evidence")):
        model.sort(column, Qt.SortOrder.AscendingOrder)
        model.show(list(graph.edges), columns)
        keys, values = quantity(graph, name, kind="edges")
        of = dict(zip(keys, values.round(9).tolist(), strict=True))
        shown = [of[model.row(row)] for row in range(model.rowCount())]
        known = [value for value in shown if value == value]
        assert known == sorted(known) and len(shown) == len(graph.edges)


def test_rows_of_a_few_keys_are_those_of_many(document: Document, settings: QSettings) -> None:
    graph = document.graph
    columns = edge_columns(graph, document.evidence)
    model = TableModel(columns)
    model.sort(2, Qt.SortOrder.DescendingOrder)
    keys = list(graph.edges)
    model.show(keys[5:])
    few, many = frozenset(keys[4:8]), frozenset(keys[2:20])
    assert [model.row(row) for row in model.places_of(few)] == [
        model.row(row) for row in model.places_of(many) if model.row(row) in few
    ]
    assert len(model.places_of(few)) == 3
