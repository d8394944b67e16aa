"""Results of evaluations: the output of a command becomes tables that a spreadsheet can import."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from pytestqt.qtbot import QtBot

from nvsim.project.jobs.joblist import JobList
from nvsim_app.look.notices import Notices
from nvsim_app.panels.results import ResultModel, ResultPanel
from nvsim_app.state.results import (
    SUMMARY,
    EvaluationResult,
    result_of_job,
    result_title,
    stored_result,
    tables_of,
    value_words,
)

FIGURES = {
    "psnr": 20.5,
    "lpips": None,
    "submaps": {"0": {"psnr": 20.1, "frames": 5}, "1": {"psnr": 21.0, "frames": 6}},
    "per_frame": [{"frame": 4, "psnr": 19.5, "name": "a, b"}, {"frame": 9, "psnr": 21.5, "name": "c"}],
    "tables": {"ablation": [{"row": "ours", "psnr": 30.0}]},
    "files": ["x.csv"],
}


def test_whatever_is_answered_becomes_tables() -> None:
    tables = {t.title: t for t in tables_of(FIGURES)}
    assert list(tables) == [SUMMARY, "Submaps", "Per frame", "Ablation"]
    assert tables[SUMMARY].rows == (("PSNR", 20.5), ("LPIPS", None))
    assert tables["Submaps"].columns == ("submap", "psnr", "frames") and tables["Submaps"].rows[1][0] == "1"
    assert tables["Per frame"].columns_to_plot == [1]


def test_a_table_survives_the_way_through_csv_and_tabs() -> None:
    table = next(t for t in tables_of(FIGURES) if t.title == "Per frame")
    for by in (",", "\t"):
        rows = list(csv.reader(io.StringIO(table.separated(by)), delimiter=by))
        assert rows[0] == ["frame", "PSNR", "name"] and rows[1] == ["4", "19.5", "a, b"]


def test_figures_and_names_are_written_as_the_field_does() -> None:
    assert result_title("psnr_nonfloor") == "PSNR no floor" and result_title("reachable_m2") == "reachable floor, m²"
    assert result_title("node_validity_low") == "validity of viewpoints, lower end of the 95 % interval"
    assert result_title("node_validity_robot") == "validity of viewpoints, for a robot"
    assert [value_words(v) for v in (None, 0.12345, 21.4727, 12345.6, 7)] == ["–", "0.1235", "21.47", "12,346", "7"]


def test_the_result_of_a_job_is_the_last_object_it_printed(tmp_path: Path) -> None:
    jobs = JobList(tmp_path / "p.nvsim")
    jobs.add("evaluate graph", ["--json"], "Evaluate the graph")
    job = jobs.claim()
    assert job is not None and result_of_job(job) is None  # it has not ended
    job.output.write_text('warm-up\n{"nodes": 5}\nnot json\n')
    jobs.finish(job, 0, "")
    ended = jobs.job(job.number)
    assert ended is not None
    result = result_of_job(ended)
    assert result is not None and result.tables[0].rows == (("viewpoints", 5),)


def test_the_panel_shows_copies_and_saves(qtbot: QtBot, tmp_path: Path, monkeypatch) -> None:
    notices = Notices()
    panel = ResultPanel(notices)
    qtbot.addWidget(panel)
    panel.resize(900, 220)
    panel.show()
    assert panel.empty.isVisible() and panel.plot is None, "a plot takes long to make"
    panel.show_results([EvaluationResult("job 1", "Evaluate views", 10.0, tables_of(FIGURES))])
    panel.tables.setCurrentText("Per frame")
    assert panel.model.rowCount() == 2 and panel.columns.currentText() == "PSNR"
    assert [panel.model.headerData(i, Qt.Orientation.Horizontal) for i in range(3)] == [
        "Frame\u2002",
        "PSNR\u2002",
        "Name",
    ]
    qtbot.mouseClick(panel.copy, Qt.MouseButton.LeftButton)
    assert QGuiApplication.clipboard().text().splitlines()[2] == "9\t21.5\tc"
    monkeypatch.setattr(
        "nvsim_app.panels.results.QFileDialog.getSaveFileName", lambda *a: (str(tmp_path / "out.csv"), "")
    )
    qtbot.mouseClick(panel.save, Qt.MouseButton.LeftButton)
    assert (tmp_path / "out.csv").read_text().startswith("frame,PSNR,name")
    monkeypatch.setattr(
        "nvsim_app.panels.results.QFileDialog.getSaveFileName", lambda *a: (str(tmp_path / "plot.png"), "")
    )
    qtbot.mouseClick(panel.save_plot, Qt.MouseButton.LeftButton)
    assert (tmp_path / "plot.png").stat().st_size > 500
    with qtbot.waitSignal(panel.frameWanted) as wanted:
        panel.view.doubleClicked.emit(panel.model.index(1, 0))
    assert wanted.args == [9]
    figures = {"nodes": 3, "near_far_2.5": 0.0}  # one name is longer than the panel is wide
    panel.show_results([stored_result("graph", 20.0, figures), *panel.results])
    panel.resize(panel.minimumSizeHint().width(), 220)
    view = panel.view

    def fits() -> bool:
        right = view.columnViewportPosition(1) + view.columnWidth(1)
        return view.width() < 400 and right <= view.viewport().width() and not view.horizontalScrollBar().isVisible()

    qtbot.waitUntil(fits)
    assert [panel.model.headerData(i, Qt.Orientation.Horizontal) for i in range(2)] == ["Figure", "Value\u2002"]
    assert panel.model.index(0, 0).data() == "Viewpoints" and panel.model.table.rows[0][0] == "viewpoints"
    assert panel.list.currentItem().text().startswith("Evaluate the graph (stored)")  # a new one is shown at once
    panel.close()


def test_the_model_keeps_qts_rules(qtmodeltester) -> None:
    model = ResultModel()
    qtmodeltester.check(model)
    for table in tables_of(FIGURES):
        model.show_table(table)
        qtmodeltester.check(model)
