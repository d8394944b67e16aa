"""A connectivity file of anyone's in the window: opened alone or in a folder, edited, saved, left."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtWidgets import QApplication, QTabBar
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.journal import sidecar
from nvsim.project.path_kind import check_openable
from nvsim.r2r.observations.stub import SCAN, write_stub_graph
from nvsim_app.session import Session
from nvsim_app.state.opened_files import GraphSource
from nvsim_app.wiring.exporting import ExportPart
from nvsim_app.wiring.files import ForeignPart
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.new_project import NewProjectPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    graph = demo_room.graph(demo_room.submaps(demo_room.capture()))
    from dataclasses import replace

    for scan in ("first", "second"):
        write_connectivity(replace(graph, scan=scan), tmp_path)
    return tmp_path


def opened(session: Session, path: Path, qtbot: QtBot) -> None:
    session.open(path)
    qtbot.waitUntil(lambda: session.document.graph is not None, timeout=10_000)
    QApplication.processEvents()


def test_a_file_alone_opens_and_is_left_as_it_was(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    before = path.read_bytes()
    check_openable(path)
    opened(session, path, qtbot)
    assert len(session.document.graph.viewpoints) == 22 and session.document.project is None
    assert session.window.windowTitle().startswith("first_connectivity.json")
    assert session.window.center.currentWidget() is session.window.scene and not session.window.scene.hint
    session.close()
    assert path.read_bytes() == before and not sidecar(path).exists()


def test_an_edit_is_saved_back_to_the_file(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    opened(session, path, qtbot)
    document = session.document
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    count = len(document.graph.edges)
    session.window.actions_table["save"].trigger()
    qtbot.waitUntil(lambda: not document.editing.dirty, timeout=20_000)
    session.close()
    from nvsim.graph.connectivity import read_connectivity

    assert len(read_connectivity(path).edges) == count
    assert not sidecar(path).exists()


def without_an_edge(session: Session) -> int:
    document = session.document
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    return len(document.graph.edges)


def test_saving_keeps_the_original_and_says_where_and_what_the_graph_fell_into(
    session: Session, folder: Path, qtbot: QtBot
) -> None:
    path = folder / "first_connectivity.json"
    before = path.read_bytes()
    opened(session, path, qtbot)
    editing = session.document.editing
    lonely = next(iter(session.document.graph.viewpoints))
    editing.run("remove_edges", {"pairs": [list(key) for key in session.document.graph.edges if lonely in key]})
    session.window.actions_table["save"].trigger()
    qtbot.waitUntil(lambda: not editing.dirty, timeout=20_000)
    assert path.with_name(f"{path.name}~").read_bytes() == before != path.read_bytes()
    said = session.window.notice_area.texts[-1]
    assert said.startswith("Saved first_connectivity.json. The original is kept as first_connectivity.json~")
    assert "2 disconnected islands (21, 1 viewpoints)" in said


def test_save_as_goes_on_in_a_copy_and_leaves_the_file_as_it_was(
    session: Session, folder: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, copy = folder / "first_connectivity.json", folder / "mine_connectivity.json"
    before = path.read_bytes()
    opened(session, path, qtbot)
    action = session.window.actions_table["save_as"]
    assert action.isEnabled() and action.shortcut().toString() == "Ctrl+Shift+S"
    count = without_an_edge(session)
    monkeypatch.setattr("nvsim_app.wiring.files.QFileDialog.getSaveFileName", lambda *_: (str(copy), ""))
    action.trigger()
    qtbot.waitUntil(lambda: session.document.path == copy and session.document.graph is not None, timeout=10_000)
    assert len(session.document.graph.edges) == count and not session.document.editing.dirty
    assert path.read_bytes() == before and not sidecar(path).exists()
    assert not list(folder.glob("*~")), "nothing was written over"
    opened(session, path, qtbot)
    assert len(session.document.graph.edges) == count + 1


def test_edits_of_a_file_that_were_not_saved_wait_beside_it(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    before = path.read_bytes()
    opened(session, path, qtbot)
    session.document.editing.run("remove_edges", {"pairs": [list(next(iter(session.document.graph.edges)))]})
    session.document.editing.close()
    assert path.read_bytes() == before and sidecar(path).exists()


def test_a_folder_opens_its_first_scan_and_steps_to_the_next(session: Session, folder: Path, qtbot: QtBot) -> None:
    check_openable(folder)
    opened(session, folder, qtbot)
    assert session.document.graph.scan == "first"
    assert session.window.actions_table["next_scan"].isEnabled()
    session.window.actions_table["next_scan"].trigger()
    qtbot.waitUntil(lambda: session.document.graph is not None and session.document.graph.scan == "second")


def test_the_stub_scan_of_an_export_is_not_listed_as_a_building(session: Session, folder: Path, qtbot: QtBot) -> None:
    write_stub_graph(folder)
    opened(session, folder, qtbot)
    part = session.window.part(ForeignPart)
    qtbot.waitUntil(lambda: part.scans.count() > 0, timeout=20_000)
    assert [part.scans.itemText(i) for i in range(part.scans.count())] == ["first", "second"]
    assert GraphSource(folder / f"{SCAN}_connectivity.json").path.is_file(), "it opens if a user selects it"


def test_a_file_that_is_no_graph_is_a_notice(session: Session, tmp_path: Path, qtbot: QtBot) -> None:
    path = tmp_path / "bad_connectivity.json"
    path.write_text('[{"image_id": 3}]')
    session.open(path)
    qtbot.waitUntil(lambda: bool(session.window.notice_area.texts), timeout=20_000)
    assert "entry 0" in session.window.notice_area.texts[0]


def test_an_empty_folder_is_refused_at_the_door(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        check_openable(tmp_path)


def tab_bars(window: MainWindow) -> list[QTabBar]:
    return window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly)


def test_the_panels_of_the_editor_come_to_the_front_and_scans_can_be_chosen(
    session: Session, folder: Path, qtbot: QtBot
) -> None:
    opened(session, folder, qtbot)
    window = session.window
    front = {"Viewpoints and edges", "Validation"}
    qtbot.waitUntil(lambda: front <= {bar.tabText(bar.currentIndex()) for bar in tab_bars(window)}, timeout=20_000)
    part = window.part(ForeignPart)
    assert [part.scans.itemText(i) for i in range(part.scans.count())] == ["first", "second"]
    part.scans.activated.emit(1)
    qtbot.waitUntil(lambda: session.document.graph is not None and session.document.path.name[0] == "s", timeout=20_000)
    assert part.scans.currentText() == "second"


def test_the_inspector_shows_the_pictures_beside_the_file_and_leads_along_edges(
    session: Session, folder: Path, qtbot: QtBot
) -> None:
    pictures = folder / "scans" / "first" / "matterport_skybox_images"
    pictures.mkdir(parents=True)
    graph = demo_room.graph(demo_room.submaps(demo_room.capture()))
    id, other = (v for v, _ in zip(graph.viewpoints, range(2), strict=False))
    strip = np.zeros((32, 192, 3), np.uint8)
    strip[:] = (40, 120, 200)
    cv2.imwrite(str(pictures / f"{id}_skybox_small.jpg"), strip)
    opened(session, folder / "first_connectivity.json", qtbot)
    document, panel = session.document, session.window.panels["inspector"]
    document.select(viewpoint=id)
    session.window.actions_table["inspect"].trigger()
    part = session.window.part(InspectorPart)
    qtbot.waitUntil(lambda: part.panoramas.current is not None, timeout=20_000)
    assert np.abs(part.panoramas.current.pixels["rgb"][..., :3].astype(int) - (40, 120, 200)).max() < 8
    assert [b.isEnabled() for b in panel.channels.buttons()] == [True, False, False]
    qtbot.waitUntil(lambda: len(panel.view.neighbors._ids) > 0, timeout=20_000)
    near = panel.view.neighbors._ids[0]
    assert near in document.graph.neighbors(id)
    assert panel.view.neighbors.neighbor_under(QPointF(*panel.view.neighbors._pixels[0])) == near
    panel.view.walked.emit(near)
    assert document.selection.viewpoint == near
    document.select(viewpoint=other)
    qtbot.waitUntil(lambda: "no image" in part.panoramas.failure_reason, timeout=20_000)


def test_a_cloud_beside_the_file_can_be_shown(session: Session, folder: Path, qtbot: QtBot) -> None:
    (folder / "cloud.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        "0 0 1\n1 2 0\n"
    )
    opened(session, folder / "first_connectivity.json", qtbot)
    (layer,) = (layer for layer in session.window.scene.overlays.layers if layer.name == "cloud")
    assert not layer.missing and len(session.document.contents.scan_cloud.points) == 2


def test_what_came_back_after_a_crash_is_said_over_the_view(session: Session, folder: Path, qtbot: QtBot) -> None:
    path = folder / "first_connectivity.json"
    opened(session, path, qtbot)
    editing = session.document.editing
    editing.run("remove_edges", {"pairs": [list(next(iter(session.document.graph.edges)))]})
    session.close_project()  # the disk holds what a crash would leave
    opened(session, path, qtbot)
    area, center = session.window.notice_area, session.window.center
    assert editing.dirty and any("1 unsaved edit" in text for text in area.texts)
    children = [child for child in center.children() if child in (area, center.currentWidget())]
    assert children[-1] is area, "the view does not cover it"


def test_a_graph_that_is_dropped_on_the_window_opens(session: Session, folder: Path, qtbot: QtBot) -> None:
    part = session.window.part(NewProjectPart)
    for what in (folder, folder / "second_connectivity.json"):
        with qtbot.waitSignal(session.window.projectChosen) as chosen:
            part.open_paths([what])
        assert chosen.args == [what]


def test_a_foreign_scan_keeps_its_poses_and_lists_and_stays_where_it_is(
    session: Session, tmp_path: Path, qtbot: QtBot
) -> None:
    """Poses turned by a quarter, and a list of who sees whom that names more than edges."""
    (tmp_path / "given").mkdir()
    given = tmp_path / "given" / "tilted_connectivity.json"
    entries = [
        {"image_id": id, "pose": [0, 0, 1, x, -1, 0, 0, 0, 0, -1, 0, 1.5, 0, 0, 0, 1], "included": True,
         "visible": [k != i for k in range(3)], "unobstructed": [abs(k - i) == 1 for k in range(3)], "height": 1.5}
        for i, (id, x) in enumerate({"a": 0, "b": 2, "c": 4}.items())
    ]  # fmt: skip
    given.write_text(json.dumps(entries))
    opened(session, given, qtbot)
    part = session.window.part(ExportPart)
    session.document.editing.run("remove_edges", {"pairs": [["a", "b"]]})
    assert not part.export("r2r", tmp_path, force=False), "a is alone now"
    assert not part.export("r2r", given.parent, force=True) and json.loads(given.read_text()) == entries
    assert part.export("r2r", tmp_path, force=True)
    found = json.loads((tmp_path / given.name).read_text())
    assert [e["pose"] for e in found] == [e["pose"] for e in entries]
    assert [e["visible"] for e in found] == [e["visible"] for e in entries]
    assert found[0]["unobstructed"] == [False] * 3
