"""The start page, and the one way to open any file."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event

import cv2
import demo_project
import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QSettings, QSize, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QApplication, QMenu, QToolBar
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.graph.connectivity import write_connectivity
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim_app.look.labels import Label
from nvsim_app.look.widgets import Scrolling
from nvsim_app.panels.new_project import NewProjectDialog
from nvsim_app.panels.open_dialog import OpenDialog
from nvsim_app.panels.start_page import StartPage
from nvsim_app.session import Session
from nvsim_app.state.folder_listing import list_folder
from nvsim_app.state.recent_projects import MOST, RecentProjects
from nvsim_app.state.side_work import LAST_VIEW, look_at
from nvsim_app.wiring.files import FilePart, RecentPart

SECONDS = 60_000


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one of everything."""
    folder = tmp_path_factory.mktemp("shelf")
    demo_project.write_project(folder / "house.nvsim", count=50, models=0)
    (folder / "walk").mkdir()
    (folder / "walk" / "transforms.json").write_text('{"frames": []}')
    write_connectivity(replace(demo_room.graph(demo_room.submaps(demo_room.capture())), scan="one"), folder / "graphs")
    shutil.copy(folder / "graphs" / "one_connectivity.json", folder / "other_connectivity.json")
    (folder / "chair.splat").write_bytes(bytes(32 * 4))
    (folder / "plain" / "deeper").mkdir(parents=True)
    (folder / "notes.txt").write_text("x")
    return folder


def test_everything_in_a_folder_is_said_what_it_is(shelf: Path) -> None:
    listing = list_folder(shelf, Event())
    assert listing is not None and listing.others == 1 and not listing.cut
    assert {e.path.name: e.kind for e in listing.entries} == {
        "graphs": "graph folder",
        "house.nvsim": "project",
        "plain": "unknown",
        "walk": "capture",
        "chair.splat": "splats",
        "other_connectivity.json": "graph",
    }
    assert [e.is_folder for e in listing.entries] == [True] * 4 + [False] * 2
    with pytest.raises(InputError, match="nowhere"):
        list_folder(shelf / "nowhere", Event())
    stopped = Event()
    stopped.set()
    assert list_folder(shelf, stopped) is None


def listed(dialog: OpenDialog, qtbot: QtBot) -> list[str]:
    qtbot.waitUntil(lambda: dialog.listing is not None and not dialog._due.isActive(), timeout=SECONDS)
    return [entry.path.name for entry in dialog.model.rows]


def test_open_is_driven_by_keys_and_opens_what_is_typed(session: Session, shelf: Path, qtbot: QtBot) -> None:
    dialog = session.window.part(FilePart).choose()
    dialog.go_to(shelf)
    assert len(listed(dialog, qtbot)) == 6 and dialog.target == (shelf, "graph folder")
    assert dialog.rest.text() == "1 file that NVSim cannot open"
    dialog.line.setFocus()
    qtbot.keyClicks(dialog.line, "plai")
    assert listed(dialog, qtbot) == ["plain"]
    qtbot.keyClick(dialog.line, Qt.Key.Key_Return)  # a folder is looked into
    assert listed(dialog, qtbot) == ["deeper"] and dialog.isVisible()
    qtbot.keyClick(dialog.list, Qt.Key.Key_Left)
    assert len(listed(dialog, qtbot)) == 6
    qtbot.keyClicks(dialog.line, "house.nvsim")
    listed(dialog, qtbot)
    assert dialog.says.text() == "house.nvsim – A project: NVSim opens it."
    dialog.grab()
    qtbot.keyClick(dialog.line, Qt.Key.Key_Return)
    assert session.document.project == shelf / "house.nvsim"


@pytest.mark.parametrize("name", ["walk", "other_connectivity.json"])
def test_each_kind_goes_where_it_belongs(session: Session, shelf: Path, qtbot: QtBot, name: str) -> None:
    dialog = session.window.part(FilePart).choose()
    dialog.go_to(shelf)
    row = listed(dialog, qtbot).index(name)
    dialog.list.setCurrentIndex(dialog.model.index(row, 0))
    qtbot.mouseClick(dialog.ok, Qt.MouseButton.LeftButton)
    if name == "walk":
        (made,) = session.window.findChildren(NewProjectDialog)
        assert made.captures() == [shelf / "walk"]
        made.reject()
    else:
        qtbot.waitUntil(lambda: session.document.path == shelf / name, timeout=SECONDS)
        assert session.document.project is None


def test_a_splat_file_that_was_chosen_is_handed_on(session: Session, shelf: Path, qtbot: QtBot) -> None:
    dialog = session.window.part(FilePart).choose()
    chosen: list[Path] = []
    session.window.projectChosen.disconnect()
    session.window.projectChosen.connect(chosen.append)
    dialog.go_to(shelf)
    listed(dialog, qtbot)
    dialog.line.setFocus()
    qtbot.keyClicks(dialog.line, "chair")
    listed(dialog, qtbot)
    qtbot.keyClick(dialog.line, Qt.Key.Key_Return)  # the only one
    assert chosen == [shelf / "chair.splat"]


def test_a_folder_that_cannot_be_read_is_said_in_the_list(session: Session, tmp_path: Path, qtbot: QtBot) -> None:
    dialog = session.window.part(FilePart).choose()
    dialog.go_to(tmp_path / "nowhere")
    qtbot.waitUntil(lambda: "nowhere" in dialog._hint.text(), timeout=SECONDS)
    dialog.reject()


def test_recent_projects_have_an_image_and_those_that_are_gone_can_be_forgotten(
    make_session: Callable[[], Session], settings: QSettings, shelf: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    house, gone = shelf / "house.nvsim", tmp_path / "gone.nvsim"
    recent = RecentProjects(settings)
    recent.remember(gone)
    recent.remember(house)
    image = np.full((300, 400, 3), 90, np.uint8)
    layout = Layout(house)
    layout.cache.mkdir(exist_ok=True)
    assert cv2.imwrite(str(layout.cache / LAST_VIEW), image)
    session = make_session()
    page = session.window.start
    assert session.window.center.currentWidget() is page
    qtbot.waitUntil(page.recent.hasFocus, timeout=5000)
    assert page.recent.current == house and page.recent.missing_projects == ()
    qtbot.waitUntil(lambda: page.recent.missing_projects == (gone,), timeout=SECONDS)
    assert not page.recent.item(0).icon().isNull() and page.recent.item(1).icon().isNull()
    page.grab()
    qtbot.keyClick(page.recent, Qt.Key.Key_Down)
    qtbot.keyClick(page.recent, Qt.Key.Key_Return)
    assert "does not exist" in session.window.notice_area.texts[-1] and session.document.path is None
    qtbot.keyClick(page.recent, Qt.Key.Key_Delete)
    assert recent.paths == (house,) and page.recent.count() == 1
    qtbot.keyClick(page.recent, Qt.Key.Key_Return)
    assert session.document.project == house and not page.isVisible()
    (menu,) = [m for m in session.window.findChildren(QMenu) if m.title() == "Open &recent"]
    menu.aboutToShow.emit()
    assert [a.text().split()[0] for a in menu.actions()] == ["house.nvsim"]
    session.close_project()
    assert page.isVisible()


@pytest.fixture
def make_session(qtbot: QtBot, settings: QSettings) -> Iterator[Callable[[], Session]]:
    made: list[Session] = []

    def make() -> Session:
        made.append(Session(settings))
        qtbot.addWidget(made[-1].window)
        made[-1].window.show()
        made[-1].window.activateWindow()
        return made[-1]

    yield make
    for session in made:
        session.close()


def test_whatever_stands_in_the_settings_is_a_list_of_paths(settings: QSettings) -> None:
    recent = RecentProjects(settings)
    for value, count in ((None, 0), ("/one", 1), (["/a", "/a", 3, ""], 2), ({"a": 1}, 0)):
        settings.setValue("recent", value)
        assert len(recent.paths) == count
    for number in range(MOST + 5):
        recent.remember(Path(f"/p{number}"))
    assert len(recent.paths) == MOST and recent.paths[0] == Path(f"/p{MOST + 4}")


def test_a_look_at_a_project_finds_an_image_that_it_has_and_fails_at_none(tmp_path: Path) -> None:
    project = tmp_path / "one.nvsim"
    Project.create_or_open(project).close()
    assert look_at(tmp_path / "nothing").there is False
    assert look_at(project).there and look_at(project).picture == b""
    photo = tmp_path / "photo.png"
    assert cv2.imwrite(str(photo), np.full((600, 900, 3), 90, np.uint8))
    layout = Layout(project)
    layout.imported.mkdir(parents=True)
    (layout.imported / "capture.json").write_text(json.dumps({"frames": [{"image": str(photo)}]}))
    small = cv2.imdecode(np.frombuffer(look_at(project).picture, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (160, 240, 3)
    (layout.imported / "capture.json").write_text(json.dumps({"frames": [{"image": "/dev/zero"}]}))
    begun = time.monotonic()
    assert look_at(project).picture == b"" and time.monotonic() - begun < 5


def test_what_the_view_showed_becomes_the_image_of_the_project(session: Session, tmp_path: Path, qtbot: QtBot) -> None:
    project = demo_project.write_project(tmp_path / "seen.nvsim", count=500, models=1)
    session.open(project)
    part = session.window.part(RecentPart)
    qtbot.waitUntil(lambda: part._seen is not None, timeout=SECONDS)
    session.close_project()
    assert (Layout(project).cache / LAST_VIEW).stat().st_size > 500
    assert look_at(project).picture


@pytest.mark.parametrize("size", [(700, 360), (960, 504), (1280, 720)])
def test_the_first_page_cuts_no_text_off(session: Session, qtbot: QtBot, size: tuple[int, int]) -> None:
    page = session.window.findChild(StartPage)
    session.window.resize(*size)
    qtbot.waitUntil(lambda: session.window.size() == QSize(*size))
    column = page.findChild(Scrolling)
    labels = column.widget().findChildren(Label)
    assert len(labels) > 6
    for label in labels:
        if label.wordWrap():
            assert label.height() >= label.heightForWidth(label.width()), label.text()
    if size[1] >= 504:
        assert not column.verticalScrollBar().isVisible(), "it fits the smallest screen"
        return
    qtbot.waitUntil(column.verticalScrollBar().isVisible)
    at = QPointF(column.viewport().rect().center())
    turn = QWheelEvent(
        at, column.viewport().mapToGlobal(at), QPoint(), QPoint(0, -2400), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(column.viewport(), turn)
    last = labels[-1]
    assert column.viewport().rect().contains(last.mapTo(column.viewport(), last.rect().bottomLeft()))


def test_the_tool_bar_appears_with_an_open_file(session: Session, shelf: Path, qtbot: QtBot) -> None:
    bar = session.window.findChild(QToolBar, "toolbar")
    assert bar is not None and not bar.isVisible()
    qtbot.mouseClick(session.window.start.open, Qt.MouseButton.LeftButton)
    dialog = session.window.findChild(OpenDialog)
    assert dialog is not None and dialog.isVisible()
    qtbot.keyClick(dialog.focusWidget() or dialog, Qt.Key.Key_Escape)
    assert not dialog.isVisible()
    session.open(shelf / "house.nvsim")
    qtbot.waitUntil(bar.isVisible, timeout=SECONDS)
    session.window.closeWanted.emit()
    qtbot.waitUntil(lambda: not bar.isVisible(), timeout=SECONDS)
