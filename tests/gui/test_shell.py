"""Help, the system report, stored views, and a project that restores its last state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from demo_project import write_project
from hypothesis import given
from hypothesis import strategies as st
from PySide6.QtCore import QSettings, Qt, QUrl
from PySide6.QtGui import QGuiApplication, QTextDocument
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim_app.painting.cameras import ViewPose
from nvsim_app.panels.about import AboutWindow, facts, version_of
from nvsim_app.panels.help import DOCS, HelpWindow, find, help_pages, open_help
from nvsim_app.session import Session
from nvsim_app.start.application import last_open_file
from nvsim_app.state.document import Document, Selection
from nvsim_app.state.view_state_store import StoredViewState, decode, encode
from nvsim_app.state.view_states import ViewState, ViewStates, changes
from nvsim_app.wiring.camera_path import CameraPathPart
from nvsim_app.wiring.views import ViewsPart
from nvsim_app.wiring.window import MainWindow

POSE = ViewPose((3.0, 4.0, 1.6), 1.1, -0.2, 2.0, 1.0)


def test_every_help_page_has_a_title_and_is_found_by_its_words() -> None:
    assert [p.name for p in help_pages()][0] == "start" and len({p.title for p in help_pages()}) == len(help_pages())
    assert find("worst cell")[0].page == "inspector"
    assert find("chair fills")[0].title == "What is measured"
    assert find("a user removed do not")[0].page == "thresholds"  # a phrase, although other pages have these words
    assert find("no such words anywhere") == [] and find("  ") == []


def test_the_help_is_searched_and_one_window_shows_all_pages(window: MainWindow, qtbot: QtBot) -> None:
    first = open_help("keys", window)
    assert "turn around" in first.text.toPlainText()
    assert open_help("frames", window) is first and "brush" in first.text.toPlainText()
    qtbot.keyClicks(first.search, "user removed do not")
    assert first.list.count() >= 1 and first.page == "thresholds"
    assert len(first.text.extraSelections()) >= 1
    first.search.setText("qqqq")
    assert "No help page contains" in first.list.item(0).text()
    first.search.clear()
    assert first.list.count() == len(help_pages())
    first.list.setCurrentRow(0)
    assert first.page == "start"
    first.show_page("window")
    pictures = [f for f in first.text.toMarkdown().split("![") if ".webp)" in f]
    assert len(pictures) >= 6
    assert all((DOCS / p.partition("](")[2].partition(")")[0]).is_file() for p in pictures)
    image = first.text.loadResource(QTextDocument.ResourceType.ImageResource.value, QUrl("window.webp"))
    assert 200 <= image.deviceIndependentSize().width() <= first.text.viewport().width()
    first.close()
    assert not [w for w in window.findChildren(HelpWindow) if w.isVisible()]


def test_the_report_names_versions_machine_and_who_draws(window: MainWindow, qtbot: QtBot) -> None:
    found = facts(Path("/somewhere/house.nvsim"))
    assert found["PySide6-Essentials"] == version_of("PySide6-Essentials") != "not installed"
    assert "GiB" in found["Memory"] and "cores" in found["Processor"] and found["OpenGL"]
    assert version_of("no-such-package") == "not installed"
    window.actions_table["about"].trigger()
    (about,) = window.findChildren(AboutWindow)
    qtbot.mouseClick(about.copy, Qt.MouseButton.LeftButton)
    assert QGuiApplication.clipboard().text() == about.report.toPlainText()
    assert "numba: " in about.report.toPlainText()
    about.close()


def test_views_go_back_and_forward_and_a_new_one_ends_the_forward_ones() -> None:
    states = ViewStates()
    made = [ViewState(replace(POSE, heading=h)) for h in (0.0, 1.0, 2.0)]
    for state in made:
        states.record(state)
    states.record(made[2])
    assert states.back() == made[1] and states.back() == made[0] and states.back() is None
    assert states.forward() == made[1]
    states.record(made[0])
    assert states.forward() is None and states.back() == made[1]


def test_a_drag_of_a_fade_is_one_step_and_the_next_drag_another() -> None:
    faded = [ViewState(POSE, layers={"cloud": (True, share)}) for share in (1.0, 0.8, 0.6, 0.4, 0.2)]
    states = ViewStates()
    for state, now in zip(faded, (0.0, 10.0, 10.1, 10.2, 20.0), strict=True):
        states.record(state, now)
    assert states.back() == faded[3] and states.back() == faded[0]
    assert list(changes(faded[0], faded[3], {"cloud": "Point cloud"}.__getitem__).values()) == ["fade point cloud"]


@given(st.lists(st.integers(0, 5), min_size=1, max_size=40), st.data())
def test_going_back_is_undone_by_going_forward(headings: list[int], data: st.DataObject) -> None:
    states = ViewStates()
    for heading in headings:
        states.record(ViewState(replace(POSE, heading=heading)))
    walked = [states.current]
    for _ in range(data.draw(st.integers(0, 10))):
        state = states.back()
        if state is None:
            break
        states.replace_current(state)
        walked.append(state)
    for state in reversed(walked[:-1]):
        assert states.forward() == state
    assert states.forward() is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"pose": 3, "channel": "rgb", "selection": {}}', '{"pose": null}'])
def test_what_somebody_wrote_into_the_settings_is_no_view(text: str) -> None:
    assert decode(text) is None
    left = StoredViewState(POSE, "alpha", Selection(frame=3), 3, (1.0, 2.0, 3.0, 4.0), (0.5, -0.5, 2.0), (POSE,))
    assert decode(encode(left)) == left


def test_back_brings_pose_channel_and_layers(window: MainWindow, qtbot: QtBot) -> None:
    part = window.part(ViewsPart)
    scene, overlays = window.scene, window.scene.overlays
    scene.navigation.set_pose(POSE)
    part._record()
    window.actions_table["alpha"].trigger()
    overlays.set_shown("graph", False)
    scene.navigation.set_pose(replace(POSE, heading=2.5))
    window.actions_table["view_back"].trigger()
    assert scene.feed.channel == "rgb" and window.actions_table["rgb"].isChecked() and overlays["graph"].shown
    qtbot.waitUntil(lambda: scene.pose == POSE, timeout=4000)
    window.actions_table["view_forward"].trigger()
    assert scene.feed.channel == "alpha" and not overlays["graph"].shown
    qtbot.waitUntil(lambda: scene.pose.heading == 2.5, timeout=4000)


def test_each_setting_of_the_view_is_a_step_of_its_own_and_says_so(window: MainWindow, qtbot: QtBot) -> None:
    table, scene, overlays = window.actions_table, window.scene, window.scene.overlays
    part = window.part(ViewsPart)
    scene.navigation.set_pose(POSE)
    part._record()
    back, settled = table["view_back"], lambda: not part._soon.isActive()

    def said() -> str:
        qtbot.waitUntil(settled, timeout=20_000)
        return back.text()

    table["depth"].trigger()
    assert said() == "&Back: show depth"
    overlays.set_shown("trajectory", False)
    assert said() == "&Back: hide trajectory"
    for share in (0.9, 0.7, 0.5):
        overlays.set_opacity("graph", share)
        assert said() == "&Back: fade graph"
    table["budget_100000"].trigger()
    assert "100\u202f000" in said()
    table["renderer_CPU"].trigger()
    assert said() == "&Back: renderer CPU"
    scene.navigation.set_pose(replace(POSE, heading=2.0))  # a movement before a setting is a step before it
    table["alpha"].trigger()
    assert said() == "&Back: show alpha"

    def seen() -> tuple[object, ...]:
        layers = overlays["trajectory"].shown, overlays["graph"].opacity
        return scene.feed.channel, *layers, scene.feed.budget, scene.feed.renderer, scene.navigation.goal.heading

    undone = [seen()]
    while back.isEnabled():
        back.trigger()
        undone.append(seen())
    assert undone == [
        ("alpha", False, 0.5, 100_000, "CPU", 2.0),
        ("depth", False, 0.5, 100_000, "CPU", 2.0),
        ("depth", False, 0.5, 100_000, "CPU", POSE.heading),
        ("depth", False, 0.5, 100_000, "automatic", POSE.heading),
        ("depth", False, 0.5, 0, "automatic", POSE.heading),
        ("depth", False, 1.0, 0, "automatic", POSE.heading),
        ("depth", True, 1.0, 0, "automatic", POSE.heading),
        ("rgb", True, 1.0, 0, "automatic", POSE.heading),
    ]
    assert "first view" in back.toolTip()
    for expected in reversed(undone[:-1]):
        table["view_forward"].trigger()
        assert seen() == expected
    assert not table["view_forward"].isEnabled() and window.settings.value("renderer") == "CPU"


def test_a_project_opens_as_it_was_left(
    make_window: Callable[[Document], MainWindow], document: Document, qtbot: QtBot
) -> None:
    first = make_window(document)
    document.select(viewpoint=document.graph_arrays.ids[4])
    first.scene.navigation.set_pose(POSE)
    first.actions_table["normal"].trigger()
    first_map, keys = first.panels["map"], first.part(CameraPathPart)
    first_map.center_on(3.0, 2.0, 1.5)
    keys.add()
    first.panels["inspector"].view.set_view_center(1.0, -0.3, 2.0)
    seen = first_map.visible_range
    first.close()

    again = Document()
    second = make_window(again)
    again.set_contents(demo_room.contents(Path("demo.nvsim")))
    assert second.scene.pose == POSE and second.scene.feed.channel == "normal"
    assert again.selection.viewpoint == document.graph_arrays.ids[4]
    assert (
        second.panels["map"].visible_range == pytest.approx(seen)
        and second.panels["inspector"].view.view_center[0] == 1.0
    )
    assert second.part(CameraPathPart).poses == [POSE]
    # Another project has a camera of its own, and this one keeps what is left now.
    second.scene.navigation.set_pose(replace(POSE, heading=0.3))
    again.set_contents(demo_room.contents(Path("other.nvsim")))
    QApplication.processEvents()
    assert again.selection.viewpoint is None
    again.set_contents(demo_room.contents(Path("demo.nvsim")))
    assert second.scene.pose == replace(POSE, heading=0.3)


def test_the_next_window_opens_what_was_open_unless_it_was_closed_or_is_gone(
    settings: QSettings, tmp_path: Path, qtbot: QtBot
) -> None:
    project = write_project(tmp_path / "rooms.nvsim", 300, 0)

    def live(close_project: bool) -> None:
        session = Session(settings)
        qtbot.addWidget(session.window)
        session.window.show()
        session.open(project)
        if close_project:
            session.window.actions_table["close_project"].trigger()
            assert session.document.path is None and session.window.center.currentWidget() is session.window.start
        session.close()

    live(close_project=False)
    assert last_open_file(settings) == project
    live(close_project=True)
    assert last_open_file(settings) is None
    live(close_project=False)
    project.rename(tmp_path / "elsewhere.nvsim")
    assert last_open_file(settings) is None
    (tmp_path / "rooms.nvsim").mkdir()
    assert last_open_file(settings) is None
