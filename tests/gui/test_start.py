"""Starting the real program: its messages if it fails, and the modules that it never imports."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import demo_project
import pytest

from nvsim_app.start.main import _ALWAYS, _XCB, why_no_window

ROOT = Path(__file__).resolve().parents[2]


def start(*arguments: str, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    own = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")}
    own |= environment if environment is not None else {"QT_QPA_PLATFORM": "offscreen"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=own, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture
def settings_home(tmp_path: Path) -> dict[str, str]:
    return {"QT_QPA_PLATFORM": "offscreen", "XDG_CONFIG_HOME": str(tmp_path / "config")}


def test_a_missing_project_is_one_sentence_and_code_2(tmp_path: Path) -> None:
    done = start("-m", "nvsim_app", "--project", str(tmp_path / "nothing.nvsim"))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "nothing.nvsim" in done.stderr and "Traceback" not in done.stderr


def test_a_folder_that_is_no_project_is_one_sentence_and_code_2(tmp_path: Path) -> None:
    (tmp_path / "project.db").write_bytes(b"not a database at all, but long enough to be taken for one" * 40)
    done = start("-m", "nvsim_app", str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr


def test_without_a_display_it_says_so_and_does_not_abort() -> None:
    done = start("-m", "nvsim_app", environment={})
    assert done.returncode == 2 and "no display" in done.stderr and done.stderr.count("\n") == 1


def test_a_display_that_does_not_answer_is_named() -> None:
    done = start("-m", "nvsim_app", environment={"DISPLAY": ":987", "QT_QPA_PLATFORM": "xcb"})
    assert done.returncode == 2 and ":987" in done.stderr and done.stderr.count("\n") == 1


def test_missing_libraries_are_named_by_their_packages() -> None:
    absent = {"libxcb-cursor.so.0", "libEGL.so.1"}
    said = why_no_window({"DISPLAY": ":0"}, lambda name: name not in absent, lambda: True, "linux")
    assert said is not None and "sudo apt install libegl1 libxcb-cursor0" in said
    said = why_no_window(
        {"QT_QPA_PLATFORM": "offscreen"}, lambda name: name != "libxcb-cursor.so.0", lambda: True, "linux"
    )
    assert said is None  # no window, no xcb
    assert why_no_window({"WAYLAND_DISPLAY": "w"}, lambda name: "xcb" not in name, lambda: True, "linux") is None
    assert why_no_window({}, lambda name: False, lambda: False, "darwin") is None


def test_the_window_imports_nothing_that_takes_long_until_it_is_usable_nor_when_a_project_is_open(
    tmp_path: Path,
) -> None:
    """The window is usable when the event loop first runs. Modules that are imported before, and work that starts by
    itself, delay this."""
    project = demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=0)
    settings = f"QSettings({str(tmp_path / 'settings.ini')!r}, QSettings.Format.IniFormat)"
    program = (
        "import sys, subprocess, threading, time; import nvsim_app.start.main, nvsim_app.start.application\n"
        "from pathlib import Path; from PySide6.QtCore import QSettings, QTimer\n"
        f"qt = nvsim_app.start.application.make_application('dark', {settings})\n"
        "from nvsim_app.session import Session\n"
        "started = []; begin = subprocess.Popen.__init__\n"
        "subprocess.Popen.__init__ = lambda self, *a, **k: (started.append(a), begin(self, *a, **k))[1]\n"
        "def heavy():\n"
        "    return [m for m in ('torch', 'numba', 'cv2', 'scipy', 'moderngl', 'matplotlib') if m in sys.modules]\n"
        f"session = Session({settings})\n"
        "session.window.show()\n"
        "usable = (heavy(), len(started), threading.active_count())\n"
        f"session.open(Path({str(project)!r})); until = time.monotonic() + 60\n"
        "while session.document.contents.occupancy is None and time.monotonic() < until: qt.processEvents()\n"
        "print(usable, heavy(), session.document.contents.occupancy is not None)\n"
        "session.close()"
    )
    done = start("-c", program)
    assert done.stdout.strip() == "([], 0, 1) [] True", done.stderr


def test_a_project_opens_and_measures_itself(tmp_path: Path, settings_home: dict[str, str]) -> None:
    project = demo_project.write_project(tmp_path / "demo.nvsim", count=2000, models=0)
    done = start("-m", "nvsim_app", "--project", str(project), "--bench", environment=settings_home)
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert set(figures) >= {"start_s", "gap_p99_ms", "gap_max_ms", "fps_moving", "sharp_ms", "rss_mb"}
    assert figures["start_s"] > 0  # how long it may take is for the bench, not for a test


def test_a_screenshot_is_written_and_the_window_closes(tmp_path: Path, settings_home: dict[str, str]) -> None:
    project = demo_project.write_project(tmp_path / "demo.nvsim", count=2000, models=1)
    picture = tmp_path / "window.png"
    done = start("-m", "nvsim_app", str(project), "--screenshot", str(picture), environment=settings_home)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 20_000


def test_a_screenshot_that_cannot_be_written_is_code_2(tmp_path: Path, settings_home: dict[str, str]) -> None:
    picture = tmp_path / "missing" / "window.png"
    done = start("-m", "nvsim_app", "--screenshot", str(picture), "--seconds", "1", environment=settings_home)
    assert done.returncode == 2 and "Cannot write" in done.stderr


def test_none_and_true_survive_many_calls_of_qt() -> None:
    """PySide6 6.12 does not count the references to them that it hands out."""
    program = (
        "import nvsim_app; from PySide6.QtCore import QObject, QTimer, Signal\n"
        "class S(QObject):\n    s = Signal()\n"
        "o, t = S(), QTimer()\nfor _ in range(200000): o.s.emit(); t.setInterval(5)\nprint(None, True)"
    )
    done = start("-c", program)
    assert done.returncode == 0 and done.stdout.strip() == "None True", done.stderr


def test_the_memory_for_models_is_remembered_until_it_is_given_back(tmp_path: Path) -> None:
    from PySide6.QtCore import QSettings

    from nvsim_app.panels.preferences import Preferences, memory_budget

    settings = QSettings(str(tmp_path / "window.ini"), QSettings.Format.IniFormat)
    preferences = Preferences(settings)
    assert memory_budget(preferences) is None
    preferences.set("memory_gib", 1.5)
    assert memory_budget(Preferences(settings)) == 3 << 29
    preferences.set("memory_gib", 0.0)
    assert memory_budget(preferences) is None
    settings.setValue("memory_gib", "plenty")
    assert memory_budget(preferences) is None


def test_every_library_that_the_window_needs_is_in_the_list_of_packages() -> None:
    listed = (ROOT / "packaging" / "system-packages.txt").read_text().split("\n")
    assert {*_ALWAYS.values(), *_XCB.values()} <= set(listed)
