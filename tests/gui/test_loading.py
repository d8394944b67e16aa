"""A project on disk and the window that follows it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import demo_project
import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.graph.operations import apply
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.session import Session
from nvsim_app.state.loading import Contents, ProjectReader
from nvsim_app.state.watcher import ProjectWatcher


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", count=3000, models=2)


def last(reader: ProjectReader) -> Contents | None:
    contents = None
    for contents in reader.updates():  # noqa: B007
        pass
    return contents


def test_everything_in_the_project_is_read(project: Path) -> None:
    reader = ProjectReader(project)
    contents = last(reader)
    reader.close()
    expected = demo_room.contents()
    assert contents is not None and len(contents.capture.frames) == 120
    assert [s.frames for s in contents.submaps] == [s.frames for s in expected.submaps]
    assert set(contents.graph.viewpoints) == set(expected.graph.viewpoints)
    assert contents.occupancy.cells.shape == expected.occupancy.cells.shape
    assert contents.scene_stamp is not None and contents.model_info[1]["psnr"] == 29.0
    assert contents.missing == ""


@pytest.mark.timeout(60)
def test_a_pipe_in_place_of_a_model_in_training_does_not_stop_the_reading(project: Path) -> None:
    live = Layout(project).checkpoints / "live_000"
    live.mkdir(parents=True)
    os.mkfifo(live / "model.json")
    reader = ProjectReader(project)
    contents = last(reader)
    reader.close()
    assert contents is not None and contents.graph is not None


def test_nothing_is_read_twice_and_only_what_changed_is_read_again(project: Path) -> None:
    reader = ProjectReader(project)
    before = last(reader)
    assert last(reader) is None
    with Project.open(project, writable=True) as writer:
        writer.set_result("graph", {"nodes": 2})
    after = last(reader)
    assert after is not None and after.results.keys() == {"graph"}
    assert after.capture is before.capture and after.graph is before.graph and after.occupancy is before.occupancy
    reader.close()


def test_a_newly_trained_model_changes_the_stamp(project: Path) -> None:
    reader = ProjectReader(project)
    before = last(reader)
    demo_project.write_model(project, 2, 1000)
    after = last(reader)
    assert after is not None and after.scene_stamp != before.scene_stamp and 2 in after.model_info
    reader.close()


def test_no_project_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        ProjectReader(tmp_path / "nothing")


def test_the_watcher_tells_the_window_what_another_process_commits(project: Path, qtbot: QtBot) -> None:
    read: list[Contents] = []
    watcher = ProjectWatcher(project)
    watcher.read.connect(read.append)
    watcher.start()
    try:
        qtbot.waitUntil(lambda: bool(read) and read[-1].occupancy is not None, timeout=10_000)
        with Project.open(project, writable=True) as writer:
            writer.set_result("graph", {"nodes": 2})
        qtbot.waitUntil(lambda: "graph" in read[-1].results, timeout=5000)
    finally:
        watcher.stop()


def test_what_was_read_before_a_stop_is_not_handed_on_after_it(qtbot: QtBot) -> None:
    for stopped in (True, False):
        reader, read = BackgroundWork("file reader"), []
        reader.start(lambda: "contents", read.append, pytest.fail)
        reader._thread.join()
        if stopped:
            reader.stop()
        QApplication.processEvents()
        assert read == ([] if stopped else ["contents"]) and not reader.busy


def test_the_result_of_earlier_work_is_dropped_and_an_error_is_one_sentence(qtbot: QtBot) -> None:
    def fail() -> None:
        raise InputError("It is damaged.")

    work, read, said = BackgroundWork("file reader"), [], []
    work.start(lambda: "earlier", read.append, said.append)
    work.start(fail, read.append, said.append)
    qtbot.waitUntil(lambda: not work.busy)
    QApplication.processEvents()
    assert read == [] and said == ["It is damaged."]


def test_a_damaged_project_is_said_once(project: Path, qtbot: QtBot) -> None:
    (project / "models" / "submap_000" / "model.json").write_text("{")
    said: list[str] = []
    watcher = ProjectWatcher(project)
    watcher.failed.connect(said.append)
    watcher.start()
    try:
        qtbot.waitUntil(lambda: bool(said), timeout=10_000)
        watcher.refresh()
        qtbot.wait(1500)
    finally:
        watcher.stop()
    assert len(said) == 1 and "model.json" in said[0]


def test_a_session_shows_a_project_and_leaves_nothing_running(project: Path, session: Session, qtbot: QtBot) -> None:
    session.open(project)
    scene = session.window.scene
    qtbot.waitUntil(lambda: scene.picture is not None and not scene.picture.request.moving, timeout=120_000)
    assert scene.picture.pixels[..., :3].std() > 5
    for channel in ("alpha", "normal", "depth"):
        session.window.actions_table[channel].trigger()
        qtbot.waitUntil(lambda c=channel: scene.picture.request.channel == c, timeout=60_000)
        assert scene.picture.pixels[..., :3].std() > 5, channel
    assert not session.window.notice_area.texts


def test_another_project_takes_the_place_of_the_first(
    project: Path, tmp_path: Path, settings: QSettings, qtbot: QtBot
) -> None:
    other = demo_project.write_project(tmp_path / "other.nvsim", count=100, models=0, with_graph=False)
    session = Session(settings)
    qtbot.addWidget(session.window)
    session.open(project)
    qtbot.waitUntil(lambda: session.document.contents.graph is not None, timeout=10_000)
    session.window.projectChosen.emit(other)
    qtbot.waitUntil(lambda: session.document.path == other and bool(session.document.contents.submaps), timeout=10_000)
    assert session.document.contents.graph is None and session.document.contents.scene_stamp is None
    session.window.projectChosen.emit(tmp_path / "nothing")
    assert session.document.path == other and len(session.window.notice_area.texts) == 1
    session.close()


def test_a_reader_never_locks_the_writer_out(project: Path) -> None:
    reader = ProjectReader(project)
    updates = reader.updates()
    next(updates)
    with Project.open(project, writable=True) as writer:
        writer.set_result("graph", {"nodes": 2})
    updates.close()
    reader.close()
    with Project.open(project) as read:
        assert read.results() == {"graph": {"nodes": 2}}


def write_floor(project: Path, submap: int, height: float) -> None:
    surface = Layout(project).surface(submap)
    surface.parent.mkdir(exist_ok=True)
    np.savez(surface, heights=np.full((40, 40), height, np.float32), origin=(-10.0, -10.0), spacing=1.0)


def test_the_window_and_the_command_find_the_same(
    project: Path, settings: QSettings, qtbot: QtBot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also off the floor and without a model, which only the project's files know; read in the reader's thread."""
    for submap in range(4):
        write_floor(project, submap, 0.0)
    with Project.open(project, writable=True) as writer:
        graph = writer.need_graph()
        first = next(iter(graph.viewpoints))
        writer.set_graph(apply(graph, "shift_viewpoints", {"ids": [first], "by": [0.0, 0.0, 0.8]}))
    main(["graph", "check", str(project), "--json"])
    (report,) = json.loads(capsys.readouterr().out)
    keys = {finding["key"] for finding in report["findings"]}
    assert f"floor/{first}" in keys and any(key.startswith("panorama/") for key in keys)
    session = Session(settings)
    session.open(project)
    qtbot.addWidget(session.window)
    checking = session.document.editing.checking
    qtbot.waitUntil(lambda: session.document.contents.context is not None, timeout=30_000)
    qtbot.waitUntil(lambda: set(checking.findings) == keys, timeout=30_000)
    demo_project.write_model(project, 2, 500)
    demo_project.write_model(project, 3, 500)
    session.window.refreshWanted.emit()
    left = {key for key in keys if not key.startswith("panorama/")}  # it is empty for a moment while it looks again
    qtbot.waitUntil(lambda: set(checking.findings) == left, timeout=30_000)
    session.close()
    assert session.document.contents.context.occupancy is session.document.contents.occupancy
