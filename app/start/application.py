"""The Qt application around a session: settings, theme, error hook, and automatic closing."""

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
from app.wiring.views import OPEN
from nvsim.errors import InputError

TURN = 0.0005  # switch interval of Python threads, seconds
_CONFIGURATION = QStandardPaths.StandardLocation.GenericConfigLocation
SETTLE = 60.0  # maximum seconds that a screenshot waits for the sharp image


def make_application(theme: str | None, settings: QSettings) -> QApplication:
    """The only QApplication of the process, with the theme applied."""
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
    """Runs the window and returns the exit code; see `main.run`."""
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
    # Threads that read a project must release Python's lock sooner than after the default of 5 ms, because the main
    # thread requests it after every Qt call, dozens of times per painting.
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
        # Slow work starts after the window is visible.
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
    """The file that was open when the last window closed; None if there was none, or if it cannot be opened."""
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
    """Checks the settings file at `path`, by default that of the user. Raises InputError if it is not a regular file;
    Qt would wait forever for a pipe."""
    if path is None:
        path = Path(QStandardPaths.writableLocation(_CONFIGURATION), "nvsim", "window.conf")
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is not a file; remove it, so that the window can store its settings there.")


@contextmanager
def _settings(remembered: bool) -> Iterator[QSettings]:
    """The settings of the user, or temporary empty settings, so that benchmarks and screenshots neither depend on the
    user's settings nor change them."""
    if remembered:
        yield QSettings("nvsim", "window")
        return
    with tempfile.TemporaryDirectory(prefix="nvsim-window-") as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        yield settings
        settings.clear()
        settings.sync()  # otherwise the destructor writes the file again


def _shoot_when_settled(app: QApplication, session: Session, path: Path, seconds: float | None) -> None:
    """Saves a screenshot of the window when the sharp image is shown or no image is needed, at the latest after
    `seconds`. Then quits."""
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
                if path.parent.is_dir():  # a missing folder is an error
                    save_image(session.window.grab(), path)
            except InputError as error:
                print(error, file=sys.stderr)
            app.quit()

    timer.timeout.connect(look)
    timer.start()
