"""The window as a whole: layout, themes, empty states, settings."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QApplication, QDockWidget, QTabBar, QToolBar
from pytestqt.qtbot import QtBot

from nvsim_app.drawing.render_child import RenderError
from nvsim_app.look import theme
from nvsim_app.look.notices import Notices
from nvsim_app.panels.stages import StageBar
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.window import MainWindow


def test_an_empty_project_says_what_to_run(make_window: Callable[[Document], MainWindow], qapp) -> None:
    window = make_window(Document(Path("new.nvsim")))
    assert window.center.currentWidget() is window.empty
    assert window.empty.sentence.text() == "The project has no capture yet." and window.empty.imports.isVisible()


def test_a_walk_without_models_is_shown_with_an_offer_to_train(window: MainWindow, document: Document) -> None:
    document.set_contents(replace(document.contents, scene_stamp=None))
    assert window.center.currentWidget() is window.scene
    (bar,) = window.scene.findChildren(StageBar)
    assert bar.isVisible() and bar.stage.text() == "Train only"
    window.grab()


def test_the_title_and_the_summary_name_the_project(window: MainWindow) -> None:
    assert window.windowTitle().startswith("demo.nvsim")
    assert "120 frames" in window._summary.text() and "viewpoints" in window._summary.text()


def test_everything_that_moves_has_a_name_for_the_stored_layout(window: MainWindow) -> None:
    for widget in (*window.findChildren(QDockWidget), *window.findChildren(QToolBar)):
        assert widget.objectName()


def test_the_layout_comes_back(settings: QSettings, document: Document, qtbot: QtBot) -> None:
    first = MainWindow(document, settings, Notices())
    qtbot.addWidget(first)
    first.show()
    first.docks["camera_path"].hide()
    first.close()
    second = MainWindow(document, settings, Notices())
    qtbot.addWidget(second)
    second.show()
    assert second.docks["camera_path"].isHidden() and not second.docks["map"].isHidden()
    second.actions_table["reset_layout"].trigger()
    assert not second.docks["camera_path"].isHidden()
    second.close()


@pytest.mark.parametrize("name", theme.THEMES)
def test_both_themes_can_be_read(name: str) -> None:
    palette = theme.palette(name)
    for ink, paper in ((palette.text(), palette.base()), (palette.windowText(), palette.window()),
                       (palette.buttonText(), palette.button()), (palette.toolTipText(), palette.toolTipBase()),
                       (palette.highlightedText(), palette.highlight())):  # fmt: skip
        assert contrast(ink.color(), paper.color()) > 4.5 or ink.color() == palette.highlightedText().color()
        assert contrast(ink.color(), paper.color()) > 3


def contrast(a, b) -> float:
    """WCAG 2.1 contrast ratio."""

    def luminance(color) -> float:
        parts = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in color.getRgbF()[:3]]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_the_theme_switches_and_is_remembered(window: MainWindow, settings: QSettings) -> None:
    dark = window.actions_table["dark"]
    start = dark.isChecked()
    dark.trigger()
    assert theme.is_dark(QApplication.palette()) != start
    assert settings.value("theme") == ("light" if start else "dark")
    window.grab()
    dark.trigger()


def test_trouble_in_the_renderer_is_a_notice(window: MainWindow) -> None:
    window.scene.link.troubled.emit(RenderError("The model is damaged.", "trace", fatal=True))
    assert window.notice_area.texts == ["The model is damaged."]
    assert window.scene.feed.note == "The model is damaged."


def test_a_picture_is_saved_and_a_failure_is_said(window: MainWindow, tmp_path: Path) -> None:
    assert window.save_picture(tmp_path / "view.png", window.scene)
    assert (tmp_path / "view.png").stat().st_size > 1000
    assert not window.save_picture(tmp_path / "view.png" / "view.png", window.scene)
    assert "Cannot write" in window.notice_area.texts[-1]


def test_next_and_previous_frame_walk_along(window: MainWindow, document: Document) -> None:
    for id, expected in (("next_frame", 0), ("next_frame", 1), ("previous_frame", 0), ("previous_frame", 119)):
        window.actions_table[id].trigger()
        assert document.selection.frame == expected


def test_every_group_of_tabs_has_one_bar(window: MainWindow, qtbot: QtBot) -> None:
    qtbot.wait(10)
    direct = Qt.FindChildOption.FindDirectChildrenOnly
    bars = [b for b in window.findChildren(QTabBar, options=direct) if b.isVisible()]
    texts = [[bar.tabText(i) for i in range(bar.count())] for bar in bars]
    assert texts and all(texts.count(t) == 1 for t in texts)


def test_a_panel_behind_a_tab_has_no_title_and_gets_it_back_alone(window: MainWindow, qtbot: QtBot) -> None:
    layers, others = window.docks["layers"], window.tabifiedDockWidgets(window.docks["layers"])
    qtbot.waitUntil(lambda: layers.titleBarWidget() is not None)
    for dock in others:
        dock.hide()
    qtbot.waitUntil(lambda: layers.titleBarWidget() is None)


def test_opening_and_closing_windows_leaves_none(settings: QSettings, qtbot: QtBot) -> None:
    before = len(QApplication.topLevelWidgets())
    for _ in range(5):
        document = Document()
        window = MainWindow(document, settings, Notices())
        window.show()
        document.set_contents(demo_room.contents(Path("demo.nvsim")))
        QApplication.processEvents()
        window.close()
        window.deleteLater()
        del window, document
        qtbot.wait(10)
    gc.collect()  # the plot's parentless context menus sit in a cycle
    assert len(QApplication.topLevelWidgets()) <= before + 1


def test_projects_follow_each_other(window: MainWindow, document: Document) -> None:
    document.set_contents(Contents(Path("other.nvsim")))
    assert window.center.currentWidget() is window.empty and window.windowTitle().startswith("other.nvsim")
    assert window.panels["submaps"].model.rowCount() == 0 and window.panels["frames"].model.rowCount() == 0


def test_a_panel_opened_in_the_window_menu_comes_before_those_of_its_place(window: MainWindow, qtbot: QtBot) -> None:
    window.show()
    window.actions_table["workspace_edit"].trigger()
    frames, history = window.docks["frames"], window.docks["history"]
    assert not history.isHidden() and frames.isHidden()
    frames.toggleViewAction().trigger()
    qtbot.waitUntil(lambda: not frames.visibleRegion().isEmpty(), timeout=3000)
