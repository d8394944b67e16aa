"""Help, the system report, views to go back to, and a project that opens as it was left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from app.cameras import ViewPose
from app.document import Document, Selection
from app.help_pages import find, pages
from app.panels.about import AboutWindow
from app.panels.help import HelpWindow, open_help
from app.parts.views import ViewsPart
from app.system_report import facts, version_of
from app.view_states import ViewState, ViewStates, decode, encode
from app.window import MainWindow

POSE = ViewPose((3.0, 4.0, 1.6), 1.1, -0.2, 2.0, 1.0)


def test_every_help_page_has_a_title_and_is_found_by_its_words() -> None:
    assert [p.name for p in pages()][0] == "start" and len({p.title for p in pages()}) == len(pages())
    assert find("worst cell")[0].page == "inspector"
    assert find("chair fills")[0].title == "What is measured"
    assert find("no such words anywhere") == [] and find("  ") == []


def test_the_help_is_searched_and_one_window_shows_all_pages(window: MainWindow, qtbot: QtBot) -> None:
    first = open_help("keys", window)
    assert "turn around" in first.text.toPlainText()
    assert open_help("frames", window) is first and "brush" in first.text.toPlainText()
    qtbot.keyClicks(first.search, "reset")
    assert first.list.count() >= 1 and first.page == "thresholds"
    assert len(first.text.extraSelections()) >= 1
    first.search.setText("qqqq")
    assert "Nothing in the help" in first.list.item(0).text()
    first.search.clear()
    assert first.list.count() == len(pages())
    first.list.setCurrentRow(0)
    assert first.page == "start"
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


@pytest.mark.parametrize("text", ["", "{", "[]", '{"pose": 3, "channel": "rgb", "selection": {}}', '{"pose": null}'])
def test_what_somebody_wrote_into_the_settings_is_no_view(text: str) -> None:
    assert decode(text) is None
    assert decode(encode(POSE, "alpha", Selection(frame=3))) == (POSE, "alpha", Selection(frame=3))


def test_back_brings_pose_channel_and_layers(window: MainWindow, qtbot: QtBot) -> None:
    part = next(p for p in window.parts if isinstance(p, ViewsPart))
    scene, overlays = window.scene, window.scene.overlays
    scene.navigation.set_pose(POSE)
    part._record()
    window.actions_table["alpha"].trigger()
    overlays.set_shown("graph", False)
    scene.navigation.set_pose(replace(POSE, heading=2.5))
    window.actions_table["view_back"].trigger()
    assert scene.channel == "rgb" and window.actions_table["rgb"].isChecked() and overlays["graph"].shown
    qtbot.waitUntil(lambda: scene.pose == POSE, timeout=4000)
    window.actions_table["view_forward"].trigger()
    assert scene.channel == "alpha" and not overlays["graph"].shown
    qtbot.waitUntil(lambda: scene.pose.heading == 2.5, timeout=4000)


def test_a_project_opens_as_it_was_left(
    make_window: Callable[[Document], MainWindow], document: Document, qtbot: QtBot
) -> None:
    first = make_window(document)
    document.select(viewpoint=document.graph_arrays.ids[4])
    first.scene.navigation.set_pose(POSE)
    first.actions_table["normal"].trigger()
    first.close()

    again = Document()
    second = make_window(again)
    again.set_contents(demo_room.contents(Path("demo.nvsim")))
    assert second.scene.pose == POSE and second.scene.channel == "normal"
    assert again.selection.viewpoint == document.graph_arrays.ids[4]
    # Another project has a camera of its own, and this one keeps what is left now.
    second.scene.navigation.set_pose(replace(POSE, heading=0.3))
    again.set_contents(demo_room.contents(Path("other.nvsim")))
    QApplication.processEvents()
    assert again.selection.viewpoint is None
    again.set_contents(demo_room.contents(Path("demo.nvsim")))
    assert second.scene.pose == replace(POSE, heading=0.3)
