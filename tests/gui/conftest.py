"""Qt offscreen, settings in a temporary file, and nothing left behind by any test."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

# Before Qt: a DISPLAY that happens to exist must not change what these tests see.
os.environ["QT_QPA_PLATFORM"] = f"offscreen:configfile={Path(__file__).parent / 'screen.json'}"

import demo_room  # noqa: E402
from PySide6.QtCore import QCoreApplication, QEvent, QSettings  # noqa: E402
from PySide6.QtWidgets import QApplication  # noqa: E402
from pytestqt.qtbot import QtBot  # noqa: E402

from nvsim_app.look.notices import Notices  # noqa: E402
from nvsim_app.session import Session  # noqa: E402
from nvsim_app.state.document import Document  # noqa: E402
from nvsim_app.wiring.window import MainWindow  # noqa: E402


@pytest.fixture
def settings(tmp_path: Path) -> QSettings:
    return QSettings(str(tmp_path / "window.ini"), QSettings.Format.IniFormat)


@pytest.fixture
def document(qapp: QApplication) -> Document:
    """The demo room, loaded."""
    made = Document()
    made.set_contents(demo_room.contents(Path("demo.nvsim")))
    return made


@pytest.fixture
def make_window(qtbot: QtBot, settings: QSettings) -> Callable[[Document], MainWindow]:
    def make(document: Document) -> MainWindow:
        window = MainWindow(document, settings, Notices())
        qtbot.addWidget(window)
        window.show()
        return window

    return make


@pytest.fixture
def window(make_window: Callable[[Document], MainWindow], document: Document) -> MainWindow:
    return make_window(document)


@pytest.fixture
def session(qtbot: QtBot, settings: QSettings) -> Iterator[Session]:
    """A window without an open file."""
    made = Session(settings)
    qtbot.addWidget(made.window)
    made.window.show()
    yield made
    made.close()


def _settle() -> None:
    for _ in range(3):
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        QCoreApplication.processEvents()
        gc.collect()


@pytest.fixture(autouse=True, scope="module")
def _collect_once_per_module() -> None:
    """Hides what stays for long from the collector, so that collecting after each test looks at its own only."""
    gc.unfreeze()
    gc.collect()


@pytest.fixture(autouse=True)
def nothing_left_behind(_collect_once_per_module: None) -> Iterator[None]:
    """Fails a test that leaves a visible window or a thread running."""
    gc.freeze()
    before = set(threading.enumerate())
    yield
    app = QApplication.instance()
    if app is None:
        return
    _settle()
    for widget in QApplication.topLevelWidgets():
        if widget.isVisible():
            widget.close()
            pytest.fail(f"a window was left open: {widget!r}")
    left = [t for t in threading.enumerate() if t not in before and t.is_alive()]
    assert not left, f"threads were left running: {left}"
