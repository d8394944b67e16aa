"""The panels render the document, and pass the person's choice to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QFontMetricsF
from pytestqt.qtbot import QtBot

from nvsim.graph.selection import GraphSelection
from nvsim_app.look.notices import Notices
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.panels.job_plots import StepAxis
from nvsim_app.panels.jobs import duration
from nvsim_app.panels.log import LogPanel
from nvsim_app.panels.stages import EmptyState
from nvsim_app.panels.submaps import SubmapPanel
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents


def test_the_model_keeps_qts_rules_while_the_document_changes(qtmodeltester, document: Document) -> None:
    panel = SubmapPanel(document)
    model = panel.model
    qtmodeltester.check(model)
    document.set_contents(replace(document.contents, submaps=document.contents.submaps[:2]))
    qtmodeltester.check(model)
    document.set_contents(Contents(Path("empty.nvsim")))
    qtmodeltester.check(model)
    assert model.rowCount() == 0


def test_submaps_tell_frames_overlap_and_quality(document: Document, qtbot: QtBot) -> None:
    panel = SubmapPanel(document)
    model = panel.model
    assert [model.index(1, c).data() for c in range(5)] == ["1", "30", "8", "27.7", "68 k"]
    assert model.index(3, 3).data() == "–"


def test_a_submap_is_selected_in_both_directions(document: Document, qtbot: QtBot) -> None:
    panel = SubmapPanel(document)
    qtbot.addWidget(panel)
    panel.table.selectRow(2)
    assert document.selection.submap == 2
    document.select(submap=0)
    assert panel.table.selectionModel().selectedRows()[0].row() == 0
    document.select(frame=5)
    assert not panel.table.selectionModel().selectedRows()


@pytest.mark.parametrize("pixels", [40, 90, 400])
@pytest.mark.parametrize("steps", [9, 640, 30_000])
def test_numbers_of_steps_have_room_beside_each_other(pixels: int, steps: int, qtbot: QtBot) -> None:
    axis = StepAxis()
    ((spacing, _),) = axis.tickSpacing(0, steps, pixels)
    width = QFontMetricsF(axis.font()).horizontalAdvance(str(steps))
    assert spacing / steps * pixels > width
    assert spacing >= 1 and spacing / 10 ** np.floor(np.log10(spacing)) in (1, 2, 5)


@pytest.mark.parametrize(("seconds", "words"), [(0, "0 s"), (42, "42 s"), (185, "3 min 05 s"), (3725, "1 h 02 min")])
def test_durations_are_readable(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_the_state_of_a_model_is_not_cut_after_training(document: Document, qtbot: QtBot) -> None:
    panel = SubmapPanel(document)
    qtbot.addWidget(panel)
    panel.resize(330, 200)
    panel.show()
    trained = {submap.index: {"steps": 2000, "psnr": 35.0, "gaussians": 80_000} for submap in document.contents.submaps}
    document.set_contents(replace(document.contents, model_info=trained))
    table, column = panel.table, panel.model.columnCount() - 1
    assert panel.model.index(0, column).data() == "trained, 2000 steps"
    assert table.columnWidth(column) >= table.sizeHintForColumn(column)


def test_details_explain_every_direction_of_a_viewpoint(document: Document, qtbot: QtBot) -> None:
    panel = DetailsPanel(document)
    qtbot.addWidget(panel)
    panel.show()
    assert "Select" in panel.words.text()
    document.select(viewpoint=document.graph_arrays.ids[0])
    text = panel.words.text()
    assert text.count("<tr>") == 8 and "obstacle at" in text and "An edge to the" in text
    assert panel.rose.isVisible()
    panel.grab()
    document.select(frame=3)
    assert panel.title.text().endswith("frame_00003.jpg") and not panel.rose.isVisible()
    document.select(submap=3)
    assert "Not trained yet" in panel.words.text()
    panel.close()


def test_the_empty_state_offers_buttons_for_the_missing_stage(qtbot: QtBot) -> None:
    state = EmptyState()
    qtbot.addWidget(state)
    state.show_message("No graph.", "map")
    assert state.sentence.text() == "No graph." and state.stage.text() == "Build the map only"
    with qtbot.waitSignal(state.stageWanted) as wanted:
        qtbot.mouseClick(state.stage, Qt.MouseButton.LeftButton)
    assert wanted.args == ["map"]


def test_the_log_keeps_notices_with_their_details(qtbot: QtBot) -> None:
    notices = Notices()
    log = LogPanel(notices)
    qtbot.addWidget(log)
    notices.error("It broke <here>.", "Traceback\n  line 3")
    assert "It broke <here>." in log.toPlainText() and "line 3" in log.toPlainText()


def test_details_tell_of_an_edge_and_of_several_things(document: Document, qtbot: QtBot) -> None:
    panel = DetailsPanel(document)
    qtbot.addWidget(panel)

    def facts() -> dict[str, str]:
        grid = panel._facts
        rows = range(grid.rowCount())
        cells = [(grid.itemAtPosition(row, 0), grid.itemAtPosition(row, 1)) for row in rows]
        return {name.widget().text(): value.widget().text() for name, value in cells if name is not None}

    key = next(iter(document.graph.edges))
    document.editing.select(GraphSelection(frozenset(), frozenset({key})))
    assert panel.title.text().startswith("Edge ")
    assert facts()["Reviewed"] == "no" and facts()["Length"].endswith(" m") and facts()["From"] == key[0]
    document.editing.run("mark_reviewed", {"edges": [list(key)]})
    assert facts()["Reviewed"] == "yes"
    ids = frozenset(document.graph_arrays.ids[:3])
    document.editing.select(GraphSelection(ids, frozenset({key})))
    assert panel.title.text() == "3 viewpoints and 1 edge"
    assert facts()["Reviewed"] == "1 of 4" and facts()["In navigation"] == "3 of 3"
    document.editing.run("lock", {"viewpoints": [min(ids)]})
    document.editing.select(GraphSelection(frozenset({min(ids)})))
    assert facts()["Locked"] == "yes"
