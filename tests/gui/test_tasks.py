"""Tasks in the window: read behind it, judged by keys, kept apart, and marked when an edit breaks them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from cut_texts import cut_texts
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QScrollArea
from pytestqt.qtbot import QtBot

from nvsim.project.jobs.files import JobCommand
from nvsim.project.jobs.joblist import Job, JobList, JobStatus
from nvsim.project.layout import Layout
from nvsim.r2r.metrics.submission import write_submission
from nvsim.r2r.reviewing import Review, read_review
from nvsim.r2r.tasks.task import Task, read_tasks, write_tasks
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.tasks import TaskPart
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WORKSPACE_LAYOUTS


def test_tasks_are_judged_rewritten_and_flagged(window: MainWindow, qtbot: QtBot, tmp_path: Path) -> None:
    graph = window.part(TaskPart).context.document.graph
    assert graph is not None
    edges = list(graph.edges)[:2]
    tasks = [Task(i, graph.scan, e, 0.5, ("Go on.",)) for i, e in enumerate(edges)]
    write_tasks(tmp_path / "R2R_train.json", [*tasks, Task(9, "elsewhere", ("x", "y"), 0.5, ("Go on.",))])
    review = Review()
    review.set_state(("R2R_train", 9, "elsewhere"), "accepted")
    review.write(tmp_path / "reviewed" / "tasks_review.json")
    part = window.part(TaskPart)
    part.open(tmp_path)
    panel = part.panel
    qtbot.waitUntil(lambda: panel.model.rowCount() == 2)
    qtbot.keyClick(panel.table, Qt.Key.Key_A)
    panel.editor.setPlainText("Walk on.")
    panel.editor.document().setModified(True)
    part.export()
    key = panel.entries[0].key
    kept = read_review(tmp_path / "reviewed" / "tasks_review.json")[key]
    assert kept.state == "accepted" and kept.instructions == ("Walk on.",)
    written = read_tasks(tmp_path / "reviewed" / "R2R_train.json")
    assert [(t.scan, t.instructions) for t in written] == [(graph.scan, ("Walk on.",)), ("elsewhere", ("Go on.",))]
    write_submission(tmp_path / "s.json", {"0_0": [(edges[0][0], 0.0, 0.0), (edges[0][1], 0.0, 0.0)]})
    part.read_submission(tmp_path / "s.json")
    qtbot.waitUntil(lambda: "0_0" in panel.model.episodes)
    assert panel.model.episodes["0_0"].spl == 1.0 and "SPL 1.00" in panel.words.text()
    qtbot.keyClick(panel.table, Qt.Key.Key_Right)
    assert panel.slider.value() == 1
    panel.editor.setPlainText("Half a sen")
    panel.editor.document().setModified(True)
    part.context.document.editing.run("remove_viewpoints", {"ids": [edges[0][0]]})
    qtbot.waitUntil(lambda: "not in the graph" in panel.model.faults.get(key, ""))
    assert panel.slider.value() == 1 and panel.editor.toPlainText() == "Half a sen"
    qtbot.waitUntil(lambda: part.panel.model.review[key].instructions == ("Half a sen",))
    part.undo()
    assert panel.model.review[key].instructions == ("Walk on.",)
    assert panel.editor.toPlainText() == "Walk on."


def test_any_instructions_trajectory_is_walked_by_keys(window: MainWindow, qtbot: QtBot, tmp_path: Path) -> None:
    part = window.part(TaskPart)
    graph = part.context.document.graph
    assert graph is not None
    ends = list(graph.edges)[0]
    write_tasks(tmp_path / "R2R_train.json", [Task(0, graph.scan, ends, 0.5, ("Go on.", "Walk."))])
    write_tasks(tmp_path / "R2R_test.json", [Task(1, graph.scan, ends, 0.5, ("Turn.",))])
    write_tasks(tmp_path / "R2R_val_seen.json", [Task(2, graph.scan, ends, 0.5, ("Not named.",))])
    there, stays = [(id, 0.0, 0.0) for id in ends], [(ends[0], 0.0, 0.0)]
    write_submission(tmp_path / "s.json", {"0_0": there, "0_1": stays})
    part.open(tmp_path / "R2R_train.json", tmp_path / "R2R_test.json")
    panel = part.panel
    qtbot.waitUntil(lambda: panel.model.rowCount() == 2)
    part.read_submission(tmp_path / "s.json")
    qtbot.waitUntil(lambda: len(panel.model.episodes) == 2)
    assert panel.shown is not None and len(panel.shown.poses) == 1  # the worst is the one that stays
    qtbot.keyClick(panel.table, Qt.Key.Key_1)
    assert len(panel.shown.poses) == 2 and "Instruction 1: success" in panel.words.text()
    qtbot.keyClick(panel.table, Qt.Key.Key_7)  # there are only two
    assert panel.which.currentIndex() == 1
    qtbot.keyClick(panel.table, Qt.Key.Key_Space)
    assert panel.walk.isChecked()
    qtbot.waitUntil(lambda: panel.slider.value() == 1 and not panel.walk.isChecked())
    panel.state.setCurrentText("Unread")
    qtbot.keyClick(panel.table, Qt.Key.Key_R)
    assert [entry.task.path_id for entry in panel.model.rows] == [1]
    panel.state.setCurrentText("Rejected")
    panel.text.setText("WALK")
    assert [entry.task.path_id for entry in panel.model.rows] == [0]


LONG = "Leave the desk on your left, pass the two white cabinets, and wait in front of the red bench at the window."


def test_exported_tasks_open_with_their_path_on_the_map(window: MainWindow, qtbot: QtBot, tmp_path: Path) -> None:
    part, project = window.part(TaskPart), tmp_path / "demo.nvsim"
    graph, canvas = part.context.document.graph, window.part(MapPart).view
    assert graph is not None
    window.resize(1280, 720)
    plain_map = canvas.grab().toImage()
    out = tmp_path / "tasks"
    tasks = [Task(i, graph.scan, ends, 0.5, (LONG,)) for i, ends in enumerate(list(graph.edges)[:3])]
    out.mkdir()
    write_tasks(out / "R2R_train.json", tasks)
    order = JobCommand("export tasks", (f"--out={out}",), "Export tasks")
    job = Job(1, project / "jobs" / "1", order, JobStatus("done"), ours=True)
    part.context.jobs.ended.emit(JobHandle(JobList(project), job, window))
    panel = part.panel
    qtbot.waitUntil(lambda: panel.isVisible() and panel.model.rowCount() == 3)
    assert panel.current is not None and canvas.grab().toImage() != plain_map
    window.docks["tasks"].hide()
    qtbot.waitUntil(lambda: canvas.grab().toImage() == plain_map)
    window.activateWindow()
    qtbot.keyClick(canvas, Qt.Key.Key_F9, Qt.KeyboardModifier.ShiftModifier)
    qtbot.waitUntil(lambda: panel.table.hasFocus() and canvas.grab().toImage() != plain_map)
    table, last = panel.table, panel.model.columnCount() - 1
    assert panel.model.index(0, last).data() == LONG
    qtbot.waitUntil(lambda: table.rowHeight(0) >= 2 * table.fontMetrics().lineSpacing())
    assert table.wordWrap()
    step = len(panel.current.task.path) - 1
    qtbot.keyClick(table, Qt.Key.Key_Down)
    qtbot.keyClick(table, Qt.Key.Key_Right)
    assert panel.current.task.path_id == 1 and panel.slider.value() == step


@pytest.mark.parametrize("workspace", [layout.id for layout in WORKSPACE_LAYOUTS])
def test_tasks_are_readable_while_jobs_are_open(
    window: MainWindow, qtbot: QtBot, tmp_path: Path, workspace: str
) -> None:
    part = window.part(TaskPart)
    graph = part.context.document.graph
    assert graph is not None
    tasks = [Task(i, graph.scan, list(graph.edges)[0], 0.5, (LONG,) * 3) for i in range(9)]
    write_tasks(tmp_path / "R2R_train.json", tasks)
    panel, table = part.panel, part.panel.table
    for (width, height), rows in {(1280, 720): 3, (960, 540): 2}.items():
        window.resize(width, height)
        window.actions_table[f"workspace_{workspace}"].trigger()
        window.actions_table["reset_layout"].trigger()
        for name in ("jobs", "tasks"):
            window.show_dock(name)
        part.open(tmp_path)
        qtbot.waitUntil(lambda: panel.model.rowCount() == 9 and table.visibleRegion().boundingRect().height() > 50)
        qtbot.wait(100)
        table.scrollToTop()
        dock = window.docks["tasks"].widget()
        assert isinstance(dock, QScrollArea) and dock.verticalScrollBar().maximum() == 0
        assert table.columnWidth(panel.model.columnCount() - 1) >= 280 and table.horizontalScrollBar().maximum() == 0
        assert not list(cut_texts(panel))
        for row in range(rows):
            cell = table.visualRect(panel.model.index(row, 1))
            assert table.viewport().visibleRegion().contains(cell), f"row {row} is not in sight"
            qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=cell.center())
            assert panel.current == panel.entries[row]


def test_tasks_of_a_renamed_project_are_shown(window: MainWindow, qtbot: QtBot, tmp_path: Path) -> None:
    part = window.part(TaskPart)
    document = part.context.document
    graph = document.graph
    assert graph is not None and document.project is not None
    document.set_contents(replace(document.contents, graph=replace(graph, scan="earlier")))
    ends = next(iter(graph.edges))
    here = Layout(document.project).scan_name
    assert here != "earlier"
    tasks = [Task(i, scan, ends, 0.5, ("Go on.",)) for i, scan in enumerate((here, "earlier", "elsewhere"))]
    write_tasks(tmp_path / "R2R_train.json", tasks)
    part.open(tmp_path)
    qtbot.waitUntil(lambda: part.panel.model.rowCount() == 2)
