"""Notices are shown, counted and closed, and an uncaught error becomes a notice."""

from __future__ import annotations

import sys
import threading

import pytest
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QToolButton, QWidget
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim_app.look.labels import Label
from nvsim_app.look.notices import MOST_SHOWN, Notice, NoticeArea, Notices, install_excepthook


@pytest.fixture
def area(qtbot: QtBot) -> NoticeArea:
    parent = QWidget()
    qtbot.addWidget(parent)
    parent.resize(800, 600)
    made = NoticeArea(Notices(), parent)
    made.parent_to_keep = parent
    return made


def test_a_notice_appears_and_is_closed_by_its_button(area: NoticeArea, qtbot: QtBot) -> None:
    area.parent_to_keep.show()

    area.show_notice(Notice("error", "The disk is full."))
    assert area.isVisible() and area.texts == ["The disk is full."]
    area.findChild(QToolButton).click()
    assert area.texts == [] and not area.isVisible()
    area.parent_to_keep.close()


def test_repeated_notices_are_counted_not_stacked(area: NoticeArea) -> None:

    for _ in range(5):
        area.show_notice(Notice("warning", "Again."))
    assert area.texts == ["Again."]
    for i in range(2 * MOST_SHOWN):
        area.show_notice(Notice("info", f"Number {i}."))
    assert len(area.texts) == MOST_SHOWN and area.texts[-1] == f"Number {2 * MOST_SHOWN - 1}."


def test_a_full_screen_lets_go_of_news_before_errors(area: NoticeArea) -> None:

    area.show_notice(Notice("error", "The disk is full."))
    for i in range(2 * MOST_SHOWN):
        area.show_notice(Notice("info", f"Number {i}."))
    assert "The disk is full." in area.texts and len(area.texts) == MOST_SHOWN


def test_a_notice_stays_while_the_pointer_rests_on_it(area: NoticeArea, qtbot: QtBot, monkeypatch) -> None:
    from PySide6.QtCore import QEvent, QPointF
    from PySide6.QtGui import QEnterEvent

    from nvsim_app.look.notices import SECONDS, Notice

    monkeypatch.setitem(SECONDS, "info", 0.05)
    area.show_notice(Notice("info", "Saved."))
    (card,) = area._cards
    card.enterEvent(QEnterEvent(QPointF(), QPointF(), QPointF()))
    qtbot.wait(120)
    assert area.texts == ["Saved."]
    card.leaveEvent(QEvent(QEvent.Type.Leave))
    qtbot.waitUntil(lambda: not area.texts, timeout=20_000)


def test_what_has_details_leads_to_the_log(area: NoticeArea, qtbot: QtBot) -> None:

    area.show_notice(Notice("error", "Odd.", "Traceback"))
    with qtbot.waitSignal(area.detailsWanted, timeout=20_000) as heard:
        area.findChild(QToolButton, "noticeDetails").click()
    assert heard.args[0].detail == "Traceback"


def test_uncaught_errors_become_notices_and_the_hooks_go_back(qapp, capsys) -> None:
    notices, heard = Notices(), []
    notices.added.connect(heard.append)
    former = sys.excepthook, threading.excepthook
    restore = install_excepthook(notices)
    try:
        sys.excepthook(ValueError, ValueError("odd"), None)
        sys.excepthook(InputError, InputError("The file is missing; choose another."), None)
        thread = threading.Thread(target=lambda: 1 / 0)
        thread.start()
        thread.join()
    finally:
        restore()
    qapp.processEvents()
    assert (sys.excepthook, threading.excepthook) == former
    assert "odd" in heard[0].text and heard[0].detail
    assert heard[1].text == "The file is missing; choose another."
    assert "division" in heard[2].text
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_an_error_while_painting_ends_the_painting(qapp) -> None:
    image = QImage(4, 4, QImage.Format.Format_RGB32)

    def paint() -> None:
        painter = QPainter(image)
        painter.drawPoint(0, 0)
        raise ValueError("odd")

    restore = install_excepthook(Notices())
    try:
        try:
            paint()
        except ValueError as error:
            assert image.paintingActive()
            sys.excepthook(ValueError, error, error.__traceback__)
    finally:
        restore()
    assert not image.paintingActive()


def test_an_error_expires_and_its_success_replaces_it(area: NoticeArea, qtbot: QtBot, monkeypatch) -> None:
    from nvsim_app.look.notices import SECONDS, Notice

    area.show_notice(Notice("error", "Cannot write map.png.", about="save"))
    area.show_notice(Notice("error", "The map failed.", about="job map"))
    area.show_notice(Notice("info", "Saved map.png.", about="save"))
    assert area.texts == ["The map failed.", "Saved map.png."]
    area.resolve("job map")
    assert area.texts == ["Saved map.png."]
    monkeypatch.setitem(SECONDS, "error", 0.05)
    area.show_notice(Notice("error", "The disk is full."))
    qtbot.waitUntil(lambda: area.texts == ["Saved map.png."], timeout=5000)


def test_messages_about_a_file_and_what_is_under_the_cursor_end_with_it(window, document) -> None:
    from pathlib import Path

    from nvsim_app.state.loading import Contents
    from nvsim_app.wiring.panels import MapPart

    plan, id = window.part(MapPart).view, document.graph_arrays.ids[0]
    window.notices.error("The graph is broken.")
    window.statusBar().showMessage("1 edge removed")
    window.scene.show_hovered(id)
    plan.show_hovered(id)
    document.set_contents(Contents(Path("other.nvsim")))
    assert window.notice_area.texts == [] and window.statusBar().currentMessage() == ""
    assert plan.graph.hovered is None and window.scene.overlays.graph.hovered is None


def test_a_notice_fits_a_narrow_view(area: NoticeArea, qtbot: QtBot) -> None:
    parent = area.parent_to_keep
    parent.show()
    words = "No region contains a path of 4 to 6 edges and at least 5 m; change the bounds."
    area.show_notice(Notice("error", words, "the details"))
    qtbot.waitUntil(lambda: area.width() == 380)
    parent.resize(240, 600)
    qtbot.waitUntil(lambda: parent.rect().contains(area.geometry()))
    (label,) = area.findChildren(Label)
    assert label.height() >= label.heightForWidth(label.width()) and label.text().endswith("the bounds.")
    button = area.findChild(QToolButton, "noticeDetails")
    assert button is not None and area.rect().contains(button.mapTo(area, button.rect().bottomRight()))
