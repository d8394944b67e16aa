"""Export a scan from the window: the form shows the size of the export, is disabled if agents cannot use it, and starts
a job that writes it."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from demo_project import write_project
from PySide6.QtCore import QObject, Qt, QUrl, Slot
from PySide6.QtGui import QDesktopServices
from pytestqt.qtbot import QtBot

from nvsim.graph.store import same_graph
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim_app.forms.form import CommandForm
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look.labels import Label
from nvsim_app.panels.jobs import JobPanel
from nvsim_app.panels.scan_estimate import ScanEstimatePanel, estimate_of
from nvsim_app.session import Session
from nvsim_app.state.document import Document
from nvsim_app.wiring.exporting import ExportPart
from nvsim_app.wiring.window import MainWindow

SECONDS = 120_000


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("project") / "room.nvsim", count=300)


@pytest.fixture
def project(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "room.nvsim"))


@pytest.fixture
def on_project(session: Session, project: Path, qtbot: QtBot) -> Iterator[Session]:
    session.open(project)
    qtbot.waitUntil(session.window.actions_table["export_scan"].isEnabled, timeout=SECONDS)
    yield session
    for job in JobList(project).jobs():
        JobList(project).kill(job.number)


@pytest.fixture
def form(on_project: Session, qtbot: QtBot) -> Iterator[CommandForm]:
    on_project.window.actions_table["export_scan"].trigger()
    shown = on_project.window.findChild(CommandForm)
    assert shown is not None
    shown.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
    shown.finish_building()
    yield shown
    shown.reject()


def panel_of(form: CommandForm) -> ScanEstimatePanel:
    panel = form.findChild(ScanEstimatePanel)
    assert panel is not None
    return panel


def answered(form: CommandForm, qtbot: QtBot) -> ScanEstimatePanel:
    """The panel once it has the estimate of the options as they stand."""
    panel = panel_of(form)
    qtbot.waitUntil(lambda: not form._try.isActive() and not panel.question.running, timeout=SECONDS)
    return panel


def texts(panel: ScanEstimatePanel) -> str:
    return " ".join(label.text() for label in panel.rows.findChildren(Label) if label.isVisibleTo(panel))


def export_part(window: MainWindow) -> ExportPart:
    return window.part(ExportPart)


def test_what_it_comes_to_stands_beside_the_options_and_follows_them(form: CommandForm, qtbot: QtBot) -> None:
    panel = answered(form, qtbot)
    assert panel.estimate is not None and panel.title.text() == "Scan room"
    first = panel.estimate
    assert first.drawn == first.todo > 0 and first.shortage == ""
    assert "views" not in [kind.what for kind in first.kinds]
    qtbot.waitUntil(lambda: "floor plans" in texts(panel), timeout=SECONDS)  # labels appear with the next layout
    assert first.time in panel.room.text() and "Free disk space there" in panel.room.text()
    form.rows["views"].editor.box.setChecked(True)
    qtbot.waitUntil(lambda: panel.estimate is not first, timeout=SECONDS)
    views = next(kind for kind in panel.estimate.kinds if kind.what == "views")
    assert views.files == 36 * first.drawn and panel.estimate.bytes > first.bytes + 1_000_000


def test_the_job_writes_what_was_said_and_its_folder_is_shown(
    on_project: Session, form: CommandForm, project: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    form.rows["size"].editor.line.setText("64")
    form.rows["plans"].editor.box.setChecked(False)
    form.rows["stub"].editor.box.setChecked(False)
    form.rows["out"].editor.line.setText(str(tmp_path / "agents"))
    said = answered(form, qtbot).estimate
    assert said is not None
    qtbot.mouseClick(form.start_button, Qt.MouseButton.LeftButton)
    handle = on_project.window.jobs.handles[-1]
    qtbot.waitUntil(lambda: handle.state in ("done", "failed"), timeout=SECONDS)
    assert handle.state == "done", handle.message
    assert handle.message == f"{said.drawn} viewpoints as scan room in {tmp_path / 'agents'}"
    written = [p for p in (tmp_path / "agents").rglob("*") if p.is_file()]
    assert len(written) == said.files
    with Project.open(project) as opened:
        ids = list(opened.need_graph().viewpoints)
    assert all(ScanPlaces(tmp_path / "agents", "room").skyboxes.strip(id).stat().st_size > 500 for id in ids)
    assert any("viewpoints in" in line.text and "files" in line.text for line in handle.history.lines)

    opener = Opener()
    QDesktopServices.setUrlHandler("file", opener, "open")
    panel = on_project.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    show_folder = panel.buttons_of[handle].commands["folder"]
    qtbot.waitUntil(show_folder.isEnabled, timeout=SECONDS)
    show_folder.trigger()
    QDesktopServices.unsetUrlHandler("file")
    assert opener.opened == [str(tmp_path / "agents")]


class Opener(QObject):
    """Takes the place of the file manager."""

    def __init__(self) -> None:
        super().__init__()
        self.opened: list[str] = []

    @Slot(QUrl)
    def open(self, url: QUrl) -> None:
        self.opened.append(url.toLocalFile())


def test_a_killed_job_goes_on_with_what_is_left(
    on_project: Session, form: CommandForm, tmp_path: Path, qtbot: QtBot
) -> None:
    form.rows["out"].editor.line.setText(str(tmp_path / "agents"))
    said = answered(form, qtbot).estimate
    assert said is not None
    qtbot.mouseClick(form.start_button, Qt.MouseButton.LeftButton)
    handle = on_project.window.jobs.handles[-1]
    journal = ScanPlaces(tmp_path / "agents", "room").journal

    def begun() -> bool:
        return journal.exists() and journal.read_bytes().count(b"\n") >= 2

    until(qtbot, begun, handle)
    os.kill(handle.job.status.pid, signal.SIGKILL)
    qtbot.waitUntil(lambda: handle.state == "interrupted", timeout=SECONDS)
    there = journal.read_bytes().count(b"\n")

    again = on_project.window.actions_table["export_scan"]
    again.trigger()
    second = next(f for f in on_project.window.findChildren(CommandForm) if f.isVisible())
    second.finish_building()
    panel = answered(second, qtbot)
    assert panel.estimate is not None and panel.estimate.drawn - panel.estimate.todo == there
    assert f"{there} of {said.drawn} viewpoints" in panel.there.text()
    second.reject()

    on_project.window.jobs.resume(handle)
    until(qtbot, lambda: journal.exists() and journal.read_bytes().count(b"\n") > there, handle)
    on_project.window.jobs.pause(handle)
    qtbot.waitUntil(lambda: handle.state == "paused", timeout=SECONDS)
    assert handle.history.progress is not None and handle.history.progress.total == said.drawn


def until(qtbot: QtBot, what: Callable[[], bool], handle: JobHandle) -> None:
    def happened() -> bool:
        assert handle.state in ("queued", "running"), handle.message
        return what()

    qtbot.waitUntil(happened, timeout=SECONDS)


def test_what_agents_cannot_use_holds_the_form_until_a_user_insists(
    on_project: Session, form: CommandForm, project: Path, qtbot: QtBot
) -> None:
    answered(form, qtbot)
    editing = on_project.document.editing
    graph = editing.graph
    assert graph is not None
    alone = next(iter(graph.viewpoints))
    assert editing.run("remove_edges", {"pairs": [list(key) for key in graph.edges if alone in key]})
    panel = panel_of(form)
    assert "1 edit of the graph is not saved; the scan is made from the saved graph" in panel.unsaved.text()
    assert panel.save.isVisible() and form.start_button.isEnabled(), "what is saved can be exported"
    qtbot.mouseClick(panel.save, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not form.start_button.isEnabled(), timeout=SECONDS)
    with Project.open(project) as opened:
        assert same_graph(opened.need_graph(), editing.graph), "the button saved it"
    assert not panel.unsaved.isVisible() and not panel.rows.isVisible()
    assert alone[:8] in form.problem.text() and "“Write despite errors”" in form.problem.text()
    assert panel.findings.isVisible()
    form.rows["force"].editor.box.setChecked(True)
    qtbot.waitUntil(form.start_button.isEnabled, timeout=SECONDS)
    assert panel.rows.isVisible() and not form.problem.isVisible()
    form.rows["force"].editor.box.setChecked(False)
    qtbot.waitUntil(panel.findings.isVisible, timeout=SECONDS)
    qtbot.mouseClick(panel.findings, Qt.MouseButton.LeftButton)
    assert not form.isVisible() and not on_project.window.panels["validation"].visibleRegion().isEmpty()


def test_a_folder_of_other_things_and_a_wrong_id_hold_the_form(form: CommandForm, tmp_path: Path, qtbot: QtBot) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("")
    out = form.rows["out"].editor.line
    before = out.text()
    out.setText(str(tmp_path / "letters"))
    qtbot.waitUntil(lambda: "other files (dear.txt)" in form.problem.text(), timeout=SECONDS)
    assert not form.start_button.isEnabled() and form.keep_button.isEnabled()
    out.setText(before)
    qtbot.waitUntil(form.start_button.isEnabled, timeout=SECONDS)
    form.rows["scan"].editor.line.setText("my_room")
    qtbot.waitUntil(lambda: "without underscore" in form.problem.text(), timeout=SECONDS)
    form.rows["size"].editor.line.setText("large")
    qtbot.waitUntil(lambda: "not a whole number" in form.problem.text(), timeout=SECONDS)
    panel_of(form).refused.emit("")
    assert "not a whole number" in form.problem.text(), "an answer that comes late hides nothing"
    assert not form.start_button.isEnabled() and not form.keep_button.isEnabled()
    form.rows["size"].editor.line.setText("100")
    form.rows["scan"].editor.line.setText("")
    qtbot.waitUntil(lambda: "“Size”" in form.problem.text(), timeout=SECONDS)


def test_a_disk_that_is_too_small_is_said_and_holds_nothing(form: CommandForm, qtbot: QtBot) -> None:
    panel = answered(form, qtbot)
    line = json.dumps(
        {"scans": ["room"], "kinds": [], "files": 3, "bytes": 9_000_000, "drawn": 3, "todo": 3, "time": "about 2 hours",
         "free": 10, "shortage": "About 9 MB are still to be written, but only 10 bytes are free at /x."}
    )  # fmt: skip
    panel.show_estimate(estimate_of(line))
    assert panel.shortage.isVisible() and "only 10 bytes are free" in panel.shortage.text()
    assert form.start_button.isEnabled()


def test_what_a_job_may_yet_mend_does_not_hold_the_form(tmp_path: Path, session: Session, qtbot: QtBot) -> None:
    project = write_project(tmp_path / "new.nvsim", count=300, models=1, with_graph=False)
    session.open(project)
    qtbot.waitUntil(lambda: session.document.contents.scene_stamp is not None, timeout=SECONDS)
    action = session.window.actions_table["export_scan"]
    assert not action.isEnabled() and "no navigation graph is built yet" in action.toolTip()
    JobList(project).add("map", ["--project", str(project)], "Build the map")  # it waits, and nobody starts it
    qtbot.waitUntil(lambda: bool(session.window.jobs.handles), timeout=SECONDS)
    session.window.actions_table.refresh()
    action.trigger()
    form = session.window.findChild(CommandForm)
    assert form is not None
    form.finish_building()
    panel = answered(form, qtbot)
    assert "running jobs may change that" in panel.title.text() and panel.estimate is None
    assert form.start_button.isEnabled() and not form.problem.isVisible()
    form.reject()


@pytest.mark.parametrize("text", ["", "[]", "3", '{"scans": 3}', '{"event": "failed"}', "{"])
def test_what_is_no_estimate_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        estimate_of(text)


def test_without_a_trained_project_the_action_says_why(
    make_window: Callable[[Document], MainWindow], document: Document, qtbot: QtBot
) -> None:
    from dataclasses import replace

    window = make_window(document)
    action = window.actions_table["export_scan"]
    assert action.isEnabled() and action.shortcut().toString() == "Ctrl+Shift+E"
    document.set_contents(replace(document.contents, scene_stamp=None))
    assert not action.isEnabled() and "no submap is trained" in action.toolTip()


def test_a_graph_alone_and_a_splat_file_say_why(tmp_path: Path, session: Session, qtbot: QtBot) -> None:
    import demo_project
    import demo_room

    from nvsim.graph.connectivity import write_connectivity
    from nvsim.splats.ply import write_ply

    graph = write_connectivity(demo_room.graph(demo_room.submaps(demo_room.capture())), tmp_path / "connectivity")
    write_ply(tmp_path / "room.ply", demo_project.gaussians(300), True)
    action = session.window.actions_table["export_scan"]
    assert "no project is open" in action.toolTip()
    session.open(graph)
    qtbot.waitUntil(lambda: session.document.graph is not None, timeout=SECONDS)
    assert not action.isEnabled() and "a graph file is open" in action.toolTip()
    session.open(tmp_path / "room.ply")
    qtbot.waitUntil(lambda: session.document.contents.outline is not None, timeout=SECONDS)
    assert not action.isEnabled() and "a splat file is open" in action.toolTip()


def test_a_dataset_says_what_speaks_against_it(on_project: Session, qtbot: QtBot) -> None:
    on_project.window.actions_table["export_dataset"].trigger()
    form = on_project.window.findChild(CommandForm)
    assert form is not None and form.verb == "export dataset"
    form.finish_building()
    panel = answered(form, qtbot)
    # The room is too small for paths of four edges, and the form says so in the command's words.
    assert panel.estimate is None and not form.start_button.isEnabled()
    form.reject()


def test_tasks_begin_with_the_scan_beside_the_project(on_project: Session, project: Path) -> None:
    (project.parent / "scans" / "connectivity").mkdir(parents=True)
    form = export_part(on_project.window).open_tasks_form()
    assert form is not None
    form.finish_building()
    assert f"--scans {project.parent / 'scans'}" in form.command.text()
    assert form.findChild(ScanEstimatePanel) is None
    form.reject()
