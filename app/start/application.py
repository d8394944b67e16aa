"""The Qt application around a session: settings, theme, error hook, and the ways it may end by itself."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QElapsedTimer, QSettings, QStandardPaths, Qt, QTimer
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QApplication

from app.drawing.renderer_choice import PREFERENCES
from app.look import theme as themes
from app.look.icons import FOLDER
from app.look.image_files import save_image
from app.look.notices import install_excepthook
from app.session import Session
from app.start.collecting import Collecting
from app.start.preparing import Preparing
from app.wiring.keeping import OPEN
from nvsim.errors import InputError

TURN = 0.0005  # seconds that a thread may keep the others waiting
_CONFIGURATION = QStandardPaths.StandardLocation.GenericConfigLocation
SETTLE = 60.0  # seconds a screenshot waits at most for the sharp image


def make_application(theme: str | None, settings: QSettings) -> QApplication:
    """The one QApplication of the process, dressed."""
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_ShareOpenGLContexts)
    existing = QApplication.instance()
    app = existing if isinstance(existing, QApplication) else QApplication(sys.argv[:1])
    app.setApplicationName("nvsim")
    app.setApplicationDisplayName("NVSim")
    app.setWindowIcon(QIcon(str(FOLDER / "app.svg")))
    stored = settings.value("theme", "dark")
    themes.apply(app, theme or (stored if stored in (*themes.THEMES, themes.SYSTEM) else "dark"))
    return app


def run_application(
    project: Path | None,
    *,
    screenshot: Path | None,
    seconds: float | None,
    theme: str | None,
    bench: int | None,
    memory: float | None,
    renderer: str | None,
) -> int:
    """See main.run."""
    with _settings(remembered=bench is None and screenshot is None) as settings:
        if renderer is not None:
            settings.setValue("renderer", next(p for p in PREFERENCES if p.lower() == renderer))
        if memory is not None:
            settings.setValue("memory_gib", memory)
        return _run(settings, project, screenshot=screenshot, seconds=seconds, theme=theme, bench=bench)


def _run(
    settings: QSettings,
    project: Path | None,
    *,
    screenshot: Path | None,
    seconds: float | None,
    theme: str | None,
    bench: int | None,
) -> int:
    app = make_application(theme, settings)
    session = Session(settings)
    restore = install_excepthook(session.notices)
    switch = sys.getswitchinterval()
    # A thread that reads a project gives way sooner than after Python's 5 ms: the window's own asks for the lock again
    # after every call of Qt, dozens of times in one painting.
    sys.setswitchinterval(TURN)
    collecting = Collecting(lambda: session.window.scene.drawing)
    preparing = Preparing(session.window, session)
    session.document.projectLeft.connect(collecting.begin_anew)
    code = 0
    try:
        session.window.show()
        if project is None and bench is None and screenshot is None:
            project = left_open(settings)
            preparing.begin()
        # What takes long begins when the window is on the screen.
        QTimer.singleShot(0, lambda: session.open(project) if project is not None else None)
        if bench is not None:
            from app.benchmarks.window import Bench

            measurement = Bench(session, bench)
            measurement.finished.connect(lambda figures: (print(json.dumps(figures)), app.quit()))
            measurement.failed.connect(lambda: app.exit(1))
            measurement.start()
        elif screenshot is not None:
            _shoot_when_settled(app, session, screenshot, seconds)
        elif seconds is not None:
            QTimer.singleShot(round(1000 * seconds), app.quit)
        code = app.exec()
        if screenshot is not None and not screenshot.is_file():
            print(f"Cannot write {screenshot}; choose a writable folder and a name ending in .png.", file=sys.stderr)
            code = 2
    finally:
        preparing.stop()
        session.close()
        collecting.stop()
        sys.setswitchinterval(switch)
        restore()
    return code


def left_open(settings: QSettings) -> Path | None:
    """What was open when the last window closed; None where nothing was, or where it can be opened no more."""
    from nvsim.project.path_kind import check_openable

    stored = str(settings.value(OPEN, "") or "")
    if not stored or not Path(stored).exists():
        return None
    try:
        check_openable(Path(stored))
    except InputError:
        return None
    return Path(stored)


def check_settings(path: Path | None = None) -> None:
    """Raises InputError where something other than a file lies at `path`, where the settings of the user are if it is
    left out: Qt would wait for a pipe forever."""
    if path is None:
        path = Path(QStandardPaths.writableLocation(_CONFIGURATION), "nvsim", "window.conf")
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is no file; remove it, so that the window can keep its settings there.")


@contextmanager
def _settings(remembered: bool) -> Iterator[QSettings]:
    """The user's own window state, or one that begins empty and is forgotten: a measurement or an image must neither
    depend on how somebody left the window nor change it."""
    if remembered:
        yield QSettings("nvsim", "window")
        return
    with tempfile.TemporaryDirectory(prefix="nvsim-window-") as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        yield settings
        settings.clear()
        settings.sync()  # or its end would write the file again


def _shoot_when_settled(app: QApplication, session: Session, path: Path, seconds: float | None) -> None:
    """Saves the window once the sharp image is there (or nothing is to be drawn), or when the time is up."""
    clock = QElapsedTimer()
    clock.start()
    limit = 1e3 * (seconds if seconds is not None else SETTLE)
    timer = QTimer(app, interval=200)

    def look() -> None:
        scene, contents = session.window.scene, session.document.contents
        read = contents.jobs or contents.capture is not None or contents.path is None or clock.elapsed() > 3000
        wants = contents.scene_stamp is not None and not session.window.notice_area.texts
        picture = scene.picture
        sharp = picture is not None and not picture.request.moving and not scene.drawing
        waited = clock.elapsed() > (2500 if seconds is None else limit)
        if (read and waited and (sharp or not wants)) or clock.elapsed() > limit:
            timer.stop()
            try:
                if path.parent.is_dir():  # a missing folder is an error, not made
                    save_image(session.window.grab(), path)
            except InputError as error:
                print(error, file=sys.stderr)
            app.quit()

    timer.timeout.connect(look)
    timer.start()
