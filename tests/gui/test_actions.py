"""The table of actions: complete, free of clashes, and honest about what cannot run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QDialog
from pytestqt.qtbot import QtBot

from nvsim_app.look.icons import icon
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.views.navigation import FLIGHTS
from nvsim_app.wiring import actions
from nvsim_app.wiring.window import MainWindow


def test_ids_and_shortcuts_are_unique_and_no_letter_is_one_that_flies() -> None:
    ids = [a.id for a in actions()]
    shortcuts = [a.shortcut for a in actions() if a.shortcut]
    assert len(set(ids)) == len(ids) and len(set(shortcuts)) == len(shortcuts)
    assert not set(shortcuts) & {flight.key for flight in FLIGHTS.values()}


@pytest.mark.parametrize("action", actions(), ids=lambda a: a.id)
def test_every_action_has_words_and_an_icon_that_exists(action, qapp) -> None:
    assert action.text and action.tip
    if action.icon:
        assert not icon(action.icon, QPalette()).pixmap(24, 24).isNull()
    assert action.icon or not action.toolbar


def test_an_action_that_cannot_run_says_why(make_window: Callable[[Document], MainWindow], qapp) -> None:
    window = make_window(Document(Path("p.nvsim")))
    above = window.actions_table["above"]
    assert not above.isEnabled()
    assert "neither a trajectory nor a graph" in above.toolTip()


def test_actions_follow_the_document(window: MainWindow, document: Document) -> None:
    focus, leave = window.actions_table["focus"], window.actions_table["leave_out_frame"]
    assert focus.isEnabled() and "Unavailable" not in focus.toolTip(), "without a selection it shows everything"
    assert not leave.isEnabled() and "Unavailable" in leave.toolTip()
    document.select(frame=3)
    assert focus.isEnabled() and leave.isEnabled()
    document.set_contents(Contents(Path("empty.nvsim")))
    assert not focus.isEnabled() and not window.actions_table["show_graph"].isEnabled()


def test_every_enabled_action_runs(
    window: MainWindow, document: Document, qtbot: QtBot, monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # the current folder may contain the project of the demo
    monkeypatch.setattr("nvsim_app.wiring.files.QFileDialog.getExistingDirectory", lambda *a: "")
    monkeypatch.setattr("nvsim_app.wiring.files.QFileDialog.getSaveFileName", lambda *a: ("", ""))
    monkeypatch.setattr("nvsim_app.wiring.files.QFileDialog.getOpenFileName", lambda *a: ("", ""))
    monkeypatch.setattr("nvsim_app.wiring.camera_path.QFileDialog.getSaveFileName", lambda *a: ("", ""))
    monkeypatch.setattr("nvsim_app.wiring.camera_path.QFileDialog.getExistingDirectory", lambda *a: "")
    monkeypatch.setattr("nvsim_app.wiring.new_project.QFileDialog.getSaveFileName", lambda *a: ("", ""))
    monkeypatch.setattr(window.jobs, "start", lambda *a: ordered.append(a[0]) or window)
    ordered: list[str] = []
    for entry in actions():
        if entry.id in ("quit", "fullscreen", "turn_up", "import"):  # for splat files, for projects without a capture
            continue
        if entry.id.startswith("storey_"):  # these need a graph with several floors; see test_storeys.py
            continue
        if entry.id in ("view_back", "view_forward"):  # these need something to go back to; see test_shell.py
            continue
        if entry.id == "earlier_results":  # this needs a stage that ran twice; see test_results_kept.py
            continue
        if entry.id == "training":  # this needs a job that trains; see test_training_window.py
            continue
        if entry.id.startswith("mask_"):  # these need a project on disk; see test_frame_page.py
            continue
        action = window.actions_table[entry.id]
        document.select(viewpoint=document.graph_arrays.ids[0])
        if not action.isEnabled():
            document.select(frame=0)
        if entry.menu in ("&Edit", "&Graph") and entry.enabled(document) is not None:
            continue  # what there is to edit changes with every edit
        if entry.id in ("save", "save_as", "next_scan", "previous_scan"):  # the demo room lies in no file
            continue
        assert action.isEnabled(), entry.id
        action.trigger()
        if entry.check and not entry.group:
            action.trigger()
    assert ordered == ["submaps", "depth", "floors", "train", "map"]
    for dialog in window.findChildren(QDialog):
        dialog.reject()
    for child in window.findChildren(type(window.notice_area)):
        child.hide()
    from nvsim_app.panels.help import HelpWindow

    pages = window.findChildren(HelpWindow)
    assert len(pages) == 1, "one window shows all pages"
    for page in pages:
        page.close()


def test_switches_show_and_hide_their_overlays(window: MainWindow) -> None:
    layers = window.scene.overlays
    for id, name in (("show_graph", "graph"), ("show_trajectory", "trajectory"), ("show_labels", "labels")):
        assert layers[name].shown
        window.actions_table[id].trigger()
        assert not layers[name].shown


def test_one_channel_is_on_at_a_time(window: MainWindow) -> None:
    table = window.actions_table
    table["depth"].trigger()
    assert window.scene.feed.channel == "depth"
    assert [a for a in ("rgb", "alpha", "normal", "depth") if table[a].isChecked()] == ["depth"]
