"""A connectivity file of anyone's in the window: opened alone or in a folder, edited, saved, left."""

from __future__ import annotations

from pathlib import Path

import demo_room
import pytest
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from app.main import check_project
from app.session import Session
from nvsim.errors import InputError
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.journal import sidecar


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    graph = demo_room.graph(demo_room.submaps(demo_room.capture()))
    from dataclasses import replace

    for scan in ("first", "second"):
        write_connectivity(replace(graph, scan=scan), tmp_path)
    return tmp_path


@pytest.fixture
def session(settings: QSettings, qtbot: QtBot):
    made = Session(settings)
    qtbot.addWidget(made.window)
    made.window.show()
    yield made
    made.close()


def opened(session: Session, path: Path, qtbot: QtBot) -> None:
    session.open(path)
    qtbot.waitUntil(lambda: session.document.graph is not None, timeout=10_000)
    QApplication.processEvents()


def test_a_file_alone_opens_and_is_left_as_it_was(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    before = path.read_bytes()
    check_project(path)
    opened(session, path, qtbot)
    assert len(session.document.graph.viewpoints) == 22 and session.document.project is None
    assert session.window.windowTitle().startswith("first_connectivity.json")
    assert session.window.centre.currentWidget() is session.window.scene and not session.window.scene.hint
    session.close()
    assert path.read_bytes() == before and not sidecar(path).exists()


def test_an_edit_is_saved_back_to_the_file(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    opened(session, path, qtbot)
    document = session.document
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    count = len(document.graph.edges)
    session.window.actions_table["save"].trigger()
    qtbot.waitUntil(lambda: not document.editing.dirty, timeout=5000)
    session.close()
    from nvsim.graph.connectivity import read_connectivity

    assert len(read_connectivity(path).edges) == count
    assert not sidecar(path).exists()


def test_edits_of_a_file_that_were_not_saved_wait_beside_it(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    before = path.read_bytes()
    opened(session, path, qtbot)
    session.document.editing.run("remove_edges", {"pairs": [list(next(iter(session.document.graph.edges)))]})
    session.document.editing.close()
    assert path.read_bytes() == before and sidecar(path).exists()


def test_a_folder_opens_its_first_scan_and_steps_to_the_next(session: Session, folder: Path, qtbot: QtBot) -> None:
    check_project(folder)
    opened(session, folder, qtbot)
    assert session.document.graph.scan == "first"
    assert session.window.actions_table["next_scan"].isEnabled()
    session.window.actions_table["next_scan"].trigger()
    qtbot.waitUntil(lambda: session.document.graph is not None and session.document.graph.scan == "second")


def test_a_file_that_is_no_graph_is_a_notice(session: Session, tmp_path: Path, qtbot: QtBot) -> None:
    path = tmp_path / "bad_connectivity.json"
    path.write_text('[{"image_id": 3}]')
    session.open(path)
    qtbot.waitUntil(lambda: bool(session.window.notice_area.texts), timeout=5000)
    assert "entry 0" in session.window.notice_area.texts[0]


def test_an_empty_folder_is_refused_at_the_door(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        check_project(tmp_path)
