"""A project that is opened and closed again and again leaves nothing behind."""

from __future__ import annotations

import gc
import threading
import weakref
from collections import Counter
from pathlib import Path

import demo_project
import psutil
import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QSettings, QTimer
from PySide6.QtWidgets import QApplication, QTabBar
from pytestqt.qtbot import QtBot

from nvsim.capture.types import Capture
from nvsim.graph.types import NavGraph
from nvsim_app.session import Session
from nvsim_app.start.application import Collecting

PATIENCE = 120_000  # milliseconds
TIMES = 3


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=1)


def _let_go(qtbot: QtBot) -> None:
    """Deletes the objects that Qt would delete later."""
    for _ in range(3):
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        qtbot.wait(1)


def _census(session: Session) -> Counter[str]:
    """How many there are of everything that a person's machine has to keep."""
    found: Counter[str] = Counter()
    for owner in (session, session.window):
        found.update(child.metaObject().className() for child in owner.findChildren(QObject))
    found["widgets"] = len(QApplication.allWidgets())
    found["running timers"] = sum(timer.isActive() for timer in session.window.findChildren(QTimer))
    found["threads"] = threading.active_count()
    found["processes"] = sum(c.status() != psutil.STATUS_ZOMBIE for c in psutil.Process().children(recursive=True))
    found["files"] = psutil.Process().num_fds() if hasattr(psutil.Process, "num_fds") else 0
    return found


def test_opening_and_closing_leaves_no_widgets_timers_threads_processes_or_files(
    project: Path, session: Session, qtbot: QtBot
) -> None:

    def open_and_close() -> None:
        session.open(project)
        qtbot.waitUntil(lambda: session.window.scene.picture is not None, timeout=PATIENCE)
        qtbot.waitUntil(lambda: session.document.contents.occupancy is not None, timeout=PATIENCE)
        session.close_project()
        _let_go(qtbot)

    open_and_close()  # what is made once stays
    before = _census(session)
    for _ in range(TIMES):
        open_and_close()
    # A journal's thread, for one, ends a moment later.
    qtbot.waitUntil(lambda: not _census(session) - before, timeout=PATIENCE)


def test_switching_workspaces_keeps_no_tab_bar_that_qt_has_deleted(
    tmp_path: Path, session: Session, qtbot: QtBot
) -> None:
    session.window.show()
    session.open(demo_project.write_project(tmp_path / "demo.nvsim", models=0))
    qtbot.waitUntil(lambda: session.document.graph is not None, timeout=PATIENCE)
    names = [f"workspace_{name}" for name in ("explore", "train", "edit", "compare")]

    def count_after_switches() -> int:
        for name in names:
            session.window.actions_table[name].trigger()
            qtbot.wait(1)
        _let_go(qtbot)
        gc.collect()
        return sum(isinstance(found, QTabBar) for found in gc.get_objects())

    count_after_switches()  # what is made once stays
    before = count_after_switches()
    count_after_switches()
    assert count_after_switches() <= before


def test_a_closed_project_is_forgotten_though_the_collector_does_not_run_by_itself(
    project: Path, settings: QSettings, qtbot: QtBot
) -> None:
    session = Session(settings)
    qtbot.addWidget(session.window)
    session.window.show()
    collecting = Collecting(lambda: True)  # the picture moves all the time
    session.document.projectLeft.connect(collecting.begin_anew)
    try:
        held: list[weakref.ref[NavGraph | Capture]] = []
        for _ in range(TIMES):
            session.open(project)
            qtbot.waitUntil(lambda: session.window.scene.picture is not None, timeout=PATIENCE)
            contents = session.document.contents
            assert contents.graph is not None and contents.capture is not None
            held += [weakref.ref(contents.graph), weakref.ref(contents.capture)]
            del contents
            gc.freeze()  # something large was put aside
            session.close_project()
            _let_go(qtbot)
        qtbot.waitUntil(lambda: all(ref() is None for ref in held), timeout=PATIENCE)
    finally:
        collecting.stop()
        session.close()
