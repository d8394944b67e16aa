"""The Qt application around a session: settings, theme, error hook, garbage collection, and automatic closing."""

from __future__ import annotations

import ctypes
import gc
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QElapsedTimer, QObject, QSettings, QStandardPaths, Qt, QTimer
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QApplication

from nvsim.errors import InputError
from nvsim_app.drawing import compilation
from nvsim_app.drawing.renderer_choice import PREFERENCES
from nvsim_app.look import theme as themes
from nvsim_app.look.icons import FOLDER, save_image
from nvsim_app.look.labels import Label
from nvsim_app.look.notices import install_excepthook
from nvsim_app.processes.child import ChildProgram
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.session import Session
from nvsim_app.wiring.views import OPEN
from nvsim_app.wiring.window import MainWindow

PERIOD = 1000  # milliseconds between two checks
YOUNG = 2_000  # net number of new objects that triggers a collection of young objects, which takes 1 ms
MANY = 40_000  # net number of new objects that indicates loaded data, which is frozen
THOROUGH = 30  # number of checks until all objects that are not frozen are collected, if nothing moves


class Collecting(QObject):
    """Runs the garbage collector only when the user does not notice the pause, until `stop`.

    By default, the collector runs after a number of allocations, in any thread, and visits all objects. With a graph of
    ten thousand viewpoints this stops all threads for 90 ms, several times while the graph is read. Here the automatic
    collection is disabled. Loaded data is frozen (gc.freeze) and never visited, young objects are collected regularly,
    and everything is collected when the project changes.

    moving   returns whether the user would notice a pause of 20 ms now
    """

    def __init__(self, moving: Callable[[], bool]) -> None:
        super().__init__()
        self._moving = moving
        self._looks = 0
        gc.disable()
        gc.freeze()
        self._timer = QTimer(self, interval=PERIOD)
        self._timer.timeout.connect(self.collect_if_idle)
        self._timer.start()
        self._anew = QTimer(self, singleShot=True, interval=0)
        self._anew.timeout.connect(self._clear)

    def begin_anew(self) -> None:
        """Collects everything, including frozen objects. Call it when a project is closed, before another is read."""
        self._anew.start()  # after all references are released

    def collect_if_idle(self) -> None:
        """Freezes loaded data or collects objects, depending on the number of new objects and on movement."""
        made = gc.get_count()[0]
        self._looks += 1
        if made > MANY:
            gc.freeze()
        elif self._looks >= THOROUGH and not self._moving():
            self._looks = 0
            gc.collect()
        elif made > YOUNG:
            gc.collect(1)

    def _clear(self) -> None:
        gc.unfreeze()
        gc.collect()
        gc.freeze()  # the objects of the window

    def stop(self) -> None:
        """Enables the automatic collection again."""
        self._timer.stop()
        self._anew.stop()
        gc.unfreeze()
        gc.enable()


WORDS = "Preparing the 3D view, once on this machine; this takes half a minute."
LATER = 2000  # milliseconds after the window opens until compilation starts; the first project is loaded by then
_PROGRAM = ChildProgram(compilation.serve, "compilation", "The renderer was not compiled ahead")


class Preparing(QObject):
    """Compiles the renderer in a side process while no reconstruction is shown: once per machine, if the installation
    did not. If `program` sends a notice, it has work to do, and a note is shown in the status bar."""

    def __init__(self, window: MainWindow, parent: QObject, program: ChildProgram = _PROGRAM) -> None:
        super().__init__(parent)
        self._window = window
        self._label = Label(window, text=WORDS)
        self._label.hide()
        self._process = SideProcess(program, self)
        self._process.heard.connect(self._show)
        self._process.ended.connect(self._label.hide)
        self._later = QTimer(self, singleShot=True, interval=LATER)
        self._later.timeout.connect(lambda: self._process.open(None))
        window.scene.feed.changed.connect(self._on_feed)

    def begin(self) -> None:
        """Starts compilation after a delay, unless a reconstruction is shown by then, which compiles the renderer
        too."""
        self._later.start()

    def stop(self) -> None:
        """Ends the process. Finished compilations stay in the cache."""
        self._later.stop()
        self._process.close()
        self._label.hide()

    def _on_feed(self) -> None:
        if self._window.scene.feed.source is not None:
            self.stop()

    def _show(self) -> None:
        self._window.statusBar().addPermanentWidget(self._label)
        self._label.show()


TURN = 0.0005  # switch interval of Python threads, seconds
_M_ARENA_MAX = -8  # of malloc.h
_CONFIGURATION = QStandardPaths.StandardLocation.GenericConfigLocation
SETTLE = 60.0  # maximum seconds that a screenshot waits for the sharp image


def _share_arenas() -> None:
    """Makes all threads allocate from two arenas of the C library of Linux. By default, each thread gets its own, and
    what it frees there is not returned to the system: the window would grow by hundreds of MiB in an hour."""
    with suppress(AttributeError, OSError, TypeError):  # there is no such function on other systems
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)


def make_application(theme: str | None, settings: QSettings) -> QApplication:
    """The only QApplication of the process, with the theme applied."""
    _share_arenas()
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
            project = last_open_file(settings)
            preparing.begin()
        # Slow work starts after the window is visible.
        QTimer.singleShot(0, lambda: session.open(project) if project is not None else None)
        if bench is not None:
            from nvsim_app.benchmarks.window import WindowBenchmark

            measurement = WindowBenchmark(session, bench)
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


def last_open_file(settings: QSettings) -> Path | None:
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

    def check_settled() -> None:
        scene, contents = session.window.scene, session.document.contents
        read = contents.capture is not None or contents.path is None or clock.elapsed() > 3000
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

    timer.timeout.connect(check_settled)
    timer.start()
