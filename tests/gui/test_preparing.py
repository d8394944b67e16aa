"""The window compiles its drawing kernels in a child process while nothing is drawn, and the status bar says so."""

from __future__ import annotations

import pytest
import side_work
from demo_room import RoomSource
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from nvsim_app.processes.child import ChildProgram
from nvsim_app.session import Session
from nvsim_app.start import application
from nvsim_app.start.application import WORDS, Preparing

BUSY = ChildProgram(side_work.until_asked, "busy", "It fails")


@pytest.fixture
def session(qtbot: QtBot, tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(application, "LATER", 1)
    made = Session(QSettings(f"{tmp_path}/window.ini", QSettings.Format.IniFormat))
    made.window.show()
    yield made
    made.close()
    made.window.deleteLater()


def _says(session: Session) -> bool:
    texts = [w for w in session.window.statusBar().findChildren(QWidget) if getattr(w, "text", str)() == WORDS]
    return any(w.isVisible() for w in texts)


def test_the_status_bar_says_what_is_going_on_and_stops_when_it_is_over(qtbot: QtBot, session: Session) -> None:
    made = Preparing(session.window, session, BUSY)
    made.begin()
    qtbot.waitUntil(lambda: _says(session), timeout=10_000)
    made._process.ask(None)
    qtbot.waitUntil(lambda: not _says(session), timeout=10_000)


def test_nothing_is_said_where_it_was_done_before(qtbot: QtBot, session: Session) -> None:
    made = Preparing(session.window, session, ChildProgram(side_work.nothing, "idle", "It fails"))
    made.begin()
    qtbot.waitUntil(lambda: made._process.running, timeout=10_000)
    qtbot.waitUntil(lambda: not made._process.running, timeout=10_000)
    assert not _says(session)


def test_it_gives_way_to_a_reconstruction(qtbot: QtBot, session: Session) -> None:
    made = Preparing(session.window, session, BUSY)
    made.begin()
    qtbot.waitUntil(lambda: _says(session), timeout=10_000)
    session.window.scene.feed.show(RoomSource())
    assert not made._process.running and not _says(session)
