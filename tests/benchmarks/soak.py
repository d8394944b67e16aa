"""Use the window at random with mouse and keyboard events, and test what it shows.

xvfb-run -a -s "-screen 0 1280x800x24" python tests/benchmarks/soak.py DEMO.nvsim [--minutes 120] [--seed 0] [--json]

DEMO comes from `nvsim demo`; it is copied. The events click, drag, scroll, and type in the views, panels, menus, and
dialogs. They edit, undo, save, reopen, change themes and workspaces, resize the window, and start jobs, which are
canceled after half a minute. In between, the benchmark tests:

- no exception, no warning of Qt, and no jump of memory;
- the findings are those of the graph on screen; the validation panel shows their numbers;
- title, status bar, undo, selection, and proposals agree with the document;
- no notice contradicts the document or stays longer than its time; no frame with a mask is listed without one.

It prints the memory of the window and its growth over the second half, from a line through all samples. If a test
fails, the exit code is 1, and the actions before are printed. `--seed` repeats a run, apart from the times.
"""

from __future__ import annotations

import ctypes
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import tyro
from harness import report
from PySide6.QtCore import QPoint, QPointF, QSettings, Qt, QTimer, QtMsgType, qInstallMessageHandler
from PySide6.QtGui import QDesktopServices, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QFileDialog,
    QLineEdit,
    QMenu,
    QTabBar,
    QWidget,
)
from shiboken6 import isValid

from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.findings import check_graph
from nvsim.graph.review import reviewable_edges
from nvsim_app.look.notices import SECONDS, Notice, install_excepthook
from nvsim_app.session import Session
from nvsim_app.start.application import Collecting, make_application
from nvsim_app.wiring.frames import FramePart

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
NONE, SHIFT, CTRL, ALT = (
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.ControlModifier,
    Qt.KeyboardModifier.AltModifier,
)
KEYS = [
    *((getattr(Qt.Key, f"Key_{c}"), NONE) for c in "ACEFGHLMNORVXYZ123456"),
    *((getattr(Qt.Key, f"Key_{name}"), NONE) for name in (
        "Delete", "Escape", "Return", "Tab", "Space", "Left", "Right", "Up", "Down", "PageUp", "PageDown", "Home",
        "F6", "F8", "F9", "F12", "Backspace")),
    *((getattr(Qt.Key, f"Key_{c}"), CTRL) for c in "ZZZYASTDEJKLP1234"),
    *((getattr(Qt.Key, f"Key_{c}"), ALT) for c in "1234"),
    *((getattr(Qt.Key, f"Key_{c}"), SHIFT) for c in "NOZ"),
    (Qt.Key.Key_F6, CTRL), (Qt.Key.Key_F8, SHIFT), (Qt.Key.Key_F9, SHIFT), (Qt.Key.Key_Left, ALT),
]  # fmt: skip
TEXTS = ("0.97", "1,4", "3", "degree > 2", "degree >", "room", "-5", "", "length > 1.5", "images/0001")
NOT_TAKEN = {"quit", "fullscreen"}  # commands that end the soak or need a window manager
STEP = 30  # milliseconds between two events
ROUND = 40  # events between two tests
QUIET = 1500  # milliseconds before a test
JOB = 30.0  # seconds until a job is canceled
REOPEN = 20  # tests between two opened files
KEPT = 40  # actions that are printed after a fault
FAULTS = 20  # faults after which the soak ends
JUMP = 1024  # MiB that the window may use more than at the test before


@dataclass(frozen=True)
class Arguments:
    """demo: a project of `nvsim demo`."""

    demo: tyro.conf.Positional[Path]
    minutes: float = 120.0
    seed: int = 0
    json: bool = False


class _Heap(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in ["arena", "a", "b", "c", "mapped", "d", "e", "used", "free", "f"]]


def heap_mib() -> float:
    """MiB that the program has allocated from the C library, without what it has freed and the library keeps."""
    read = ctypes.CDLL("libc.so.6").mallinfo2
    read.restype = _Heap
    heap = read()
    return (heap.used + heap.mapped) / 2**20


class Soak:
    """Sends the events and makes the tests. `run` returns the figures and the faults."""

    def __init__(self, session: Session, files: list[Path], minutes: float, seed: int) -> None:
        self.session, self.window, self.document = session, session.window, session.document
        self.files, self.random = files, random.Random(seed)
        self.begun = time.monotonic()
        self.end = self.begun + 60 * minutes
        self.actions: deque[str] = deque(maxlen=KEPT)
        self.counts: Counter[str] = Counter()
        self.faults: list[str] = []
        self.memory: list[tuple[float, float]] = []
        self.peak, self._usual = 0.0, np.inf  # MiB
        self.tests, self.events, self.depth = 0, 0, 0
        self._since_test = 0
        self._testing = False
        self._jobs: dict[int, float] = {}
        self._ways: list[tuple[float, Callable[[], str]]] = [
            (6, self._click_view), (4, self._drag_view), (2, self._wheel), (2, self._context_menu), (8, self._key),
            (3, self._menu), (5, self._control), (1, self._type), (0.3, self._resize), (0.1, self._job),
        ]  # fmt: skip
        session.notices.added.connect(self._on_notice)
        for id in NOT_TAKEN:
            self.window.actions_table[id].setVisible(False)

    # The events ------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        if time.monotonic() > self.end or len(self.faults) >= FAULTS:
            QApplication.exit()
            return
        if self._testing:
            return
        # The next step is scheduled first, because an event may run a menu or a dialog with its own event loop.
        if self._since_test >= ROUND and self.depth == 0:
            self._since_test, self._testing = 0, True
            QTimer.singleShot(QUIET, self._test)
            return
        QTimer.singleShot(STEP, self.step)
        self._since_test += 1
        self.events += 1
        self.depth += 1
        try:
            self._act()
        finally:
            self.depth -= 1
        self._weigh()

    def _weigh(self) -> None:
        """A fault if the window uses much more memory than at the test before."""
        memory = psutil.Process().memory_info().rss / 2**20
        self.peak = max(self.peak, memory)
        if memory > self._usual + JUMP:
            self.fault(f"memory jumped from {self._usual:.0f} to {memory:.0f} MiB")
            self._usual = memory

    def _act(self) -> None:
        popup, modal = QApplication.activePopupWidget(), QApplication.activeModalWidget()
        if self.depth > 3 or (self._since_test >= ROUND and self.depth > 1):
            self._escape(popup or modal or self.window)
        elif popup is not None:
            self._in_popup(popup)
        elif modal is not None:
            self._in_dialog(modal)
        else:
            dialogs = [w for w in QApplication.topLevelWidgets() if isinstance(w, QDialog) and w.isVisible()]
            if dialogs and self.random.random() < 0.3:
                self._in_dialog(self.random.choice(dialogs))
                return
            weights = [weight for weight, _ in self._ways]
            way = self.random.choices(self._ways, weights)[0][1]
            self._note(way())

    def _note(self, what: str) -> None:
        if what:
            self.actions.append(what)
            self.counts[what.split()[0]] += 1

    def _escape(self, widget: QWidget) -> None:
        self._note(f"escape {type(widget).__name__}")
        QTest.keyClick(widget, Qt.Key.Key_Escape)

    def _in_popup(self, popup: QWidget) -> None:
        if isinstance(popup, QMenu) and self.random.random() < 0.6:
            offered = [a for a in popup.actions() if a.isVisible() and a.isEnabled() and a.text()]
            if offered:
                action = self.random.choice(offered)
                self._note(f"choose {action.text()}")
                QTest.mouseClick(popup, LEFT, NONE, popup.actionGeometry(action).center())
                return
        if isinstance(popup, QAbstractItemView) or self.random.random() < 0.4:
            self._note(f"press in {type(popup).__name__}")
            QTest.mouseClick(popup, LEFT, NONE, self._inside(popup))
        else:
            self._escape(popup)

    def _in_dialog(self, dialog: QWidget) -> None:
        if isinstance(dialog, QFileDialog) or self.random.random() < 0.35:
            self._escape(dialog)
        else:
            self._note(self._control(dialog))

    def _inside(self, widget: QWidget) -> QPoint:
        width, height = max(1, widget.width()), max(1, widget.height())
        return QPoint(self.random.randrange(width), self.random.randrange(height))

    def _view(self) -> QWidget | None:
        shown = [c.surface.widget for c in self.window.modes.canvases if c.surface.widget.isVisible()]
        return self.random.choice(shown) if shown else None

    def _place(self, view: QWidget) -> QPoint:
        """A pixel of a view, often that of a viewpoint."""
        feet = self.document.graph_arrays.feet if self.document.graph is not None else ()
        if len(feet) and self.random.random() < 0.7:
            surface = next(c.surface for c in self.window.modes.canvases if c.surface.widget is view)
            pixels, depths = surface.project(np.asarray(feet))
            seen = pixels[(depths > 0) & ((pixels > 0) & (pixels < view.size().toTuple())).all(axis=1)]
            if len(seen):
                return QPointF(*self.random.choice(seen.tolist())).toPoint()
        return self._inside(view)

    def _held(self) -> Qt.KeyboardModifier:
        return self.random.choice((NONE, NONE, NONE, SHIFT, CTRL))

    def _click_view(self) -> str:
        view = self._view()
        if view is None:
            return ""
        at, held = self._place(view), self._held()
        QTest.mouseMove(view, at)
        click = QTest.mouseDClick if self.random.random() < 0.1 else QTest.mouseClick
        click(view, LEFT, held, at)
        return f"click {view.objectName() or type(view).__name__} {at.toTuple()} {held.name}"

    def _drag_view(self) -> str:
        view = self._view()
        if view is None:
            return ""
        a, b, held = self._place(view), self._place(view), self._held()
        button = self.random.choice((LEFT, LEFT, RIGHT, Qt.MouseButton.MiddleButton))
        QTest.mouseMove(view, a)
        QTest.mousePress(view, button, held, a)
        for share in (0.1, 0.5, 1.0):
            QTest.mouseMove(view, a + (b - a) * share)
        QTest.mouseRelease(view, button, held, b)
        return f"drag {type(view).__name__} {a.toTuple()} {b.toTuple()} {button.name} {held.name}"

    def _wheel(self) -> str:
        view = self._view()
        if view is None:
            return ""
        at, turn = QPointF(self._place(view)), self.random.choice((120, -120, 360))
        event = QWheelEvent(at, view.mapToGlobal(at), QPoint(), QPoint(0, turn), Qt.MouseButton.NoButton, NONE,
                            Qt.ScrollPhase.NoScrollPhase, False)  # fmt: skip
        QApplication.sendEvent(view, event)
        return f"wheel {turn}"

    def _context_menu(self) -> str:
        view = self._view()
        if view is None:
            return ""
        at = self._place(view)
        self._note(f"context menu {at.toTuple()}")
        QTest.mouseClick(view, RIGHT, NONE, at)
        return ""

    def _key(self) -> str:
        target = QApplication.focusWidget() or self.window
        key, held = self.random.choice(KEYS)
        text = key.name.removeprefix("Key_")
        self._note(f"key {text} {held.name} in {type(target).__name__}")
        QTest.keyClick(target, key, held)
        return ""

    def _menu(self) -> str:
        bar = self.window.menuBar()
        titles = [a for a in bar.actions() if a.isVisible() and a.menu() is not None]
        title = self.random.choice(titles)
        self._note(f"menu {title.text()}")
        QTest.mouseClick(bar, LEFT, NONE, bar.actionGeometry(title).center())
        return ""

    def _control(self, within: QWidget | None = None) -> str:
        kinds = (QAbstractButton, QComboBox, QAbstractSlider, QAbstractSpinBox, QTabBar, QAbstractItemView, QLineEdit)
        root = within or self.window
        found = [w for w in root.findChildren(QWidget) if isinstance(w, kinds) and w.isVisible() and w.isEnabled()]
        found = [w for w in found if not w.visibleRegion().isEmpty()]
        if not found:
            self._escape(root)
            return ""
        widget = self.random.choice(found)
        target = widget.viewport() if isinstance(widget, QAbstractItemView) else widget
        words = widget.text() if isinstance(widget, QAbstractButton | QLineEdit) else ""
        self._note(f"control {type(widget).__name__} {words or widget.accessibleName() or widget.objectName()}")
        at = self._inside(target)
        QTest.mouseMove(target, at)
        if isValid(target):  # rows may get other widgets meanwhile
            QTest.mouseClick(target, LEFT, NONE, at)
        return ""

    def _type(self) -> str:
        fields = [w for w in self.window.findChildren(QLineEdit) if w.isVisible() and w.isEnabled()]
        if not fields:
            return ""
        field, text = self.random.choice(fields), self.random.choice(TEXTS)
        self._note(f"type {text!r} in {field.accessibleName() or type(field.parent()).__name__}")
        field.setFocus()
        QTest.keyClick(field, Qt.Key.Key_A, CTRL)
        QTest.keyClicks(field, text)
        QTest.keyClick(field, self.random.choice((Qt.Key.Key_Return, Qt.Key.Key_Tab, Qt.Key.Key_Escape)))
        return ""

    def _resize(self) -> str:
        size = self.random.choice(((960, 540), (1280, 720), (1280, 800), (1100, 640)))
        self.window.resize(*size)
        return f"resize {size}"

    def _job(self) -> str:
        project = self.document.project
        if project is None or self.window.jobs.busy:
            return ""
        words = ["--project", str(project), "--submaps", "0", "--steps", "40", "--image-size", "120"]
        self.window.jobs.start("train", words, project, "Train submap 0")
        return "job train"

    # The tests -------------------------------------------------------------------------------------------------------

    def fault(self, sentence: str) -> None:
        self.faults.append(sentence)
        print(f"FAULT after {self.events} events: {sentence}", file=sys.stderr)
        print("   " + "\n   ".join(self.actions), file=sys.stderr, flush=True)

    def _on_notice(self, notice: Notice) -> None:
        editing = self.document.editing
        graph = editing.graph
        if notice.text.startswith("Unexpected error"):
            self.fault(f"{notice.text}\n{notice.detail}")
        if notice.text == "No problems found." and (not editing.checking.complete or self._open_findings()):
            self.fault("a notice says that there are no problems, but there are findings")
        reviewed = graph is None or all(graph.edges[key].reviewed for key in reviewable_edges(graph))
        if notice.text == "Every edge between included viewpoints is reviewed." and not reviewed:
            self.fault("a notice says that every edge is reviewed")
        if notice.severity == "error":
            self._note(f"error {notice.text}")

    def _open_findings(self) -> int:
        """The number of findings that the user does not ignore."""
        editing = self.document.editing
        ignored = editing.graph.ignored if editing.graph is not None else {}
        return sum(not f.ignored_by(ignored) for f in editing.findings.values())

    def _test(self) -> None:
        try:
            for test in (self._findings, self._words, self._stale):
                test()
        except Exception:
            self.fault(traceback.format_exc())
        self.tests += 1
        self._usual = psutil.Process().memory_info().rss / 2**20
        self.memory.append((time.monotonic(), self._usual))
        if self.tests % 10 == 0:
            jobs = ", ".join(f"{h.title} {h.state}" for h in self.window.jobs.handles[-3:])
            memory = f"{self._usual:.0f} MiB, {heap_mib():.0f} of them allocated"
            print(f"{self.events} events, {self.tests} tests, {memory}, {jobs}", file=sys.stderr)
        self._end_jobs()
        if self.tests % REOPEN == 0 or self.document.path is None:
            file = self.random.choice(self.files)
            self._note(f"open {file.name}")
            self.session.open(file)
        self._testing = False
        QTimer.singleShot(0, self.step)

    def _findings(self) -> None:
        editing = self.document.editing
        if editing.graph is None or not editing.checking.complete:
            return
        checking = editing.checking
        known = checking._known if checking._file is None else checking._file.context(checking._known)
        expected = {f.key for f in check_graph(editing.graph, known)}
        if expected != set(editing.findings):
            self.fault(f"findings differ: {expected ^ set(editing.findings)}")
        panel = self.window.panels["validation"]
        seen = not panel.visibleRegion().isEmpty() and panel.clean.isVisible()
        if seen and panel.clean.text() == "No problems found." and self._open_findings():
            self.fault("the panel says that there are no problems")

    def _words(self) -> None:
        window, editing, document = self.window, self.document.editing, self.document
        graph = editing.graph
        if window.isWindowModified() != editing.dirty:
            self.fault("the star in the title is wrong")
        name = document.contents.path.name if document.contents.path is not None else "NVSim"
        if not window.windowTitle().startswith(name):
            self.fault(f"the title {window.windowTitle()} is not that of {name}")
        summary = window._summary.text()
        if graph is not None:
            for number, noun in ((len(graph.viewpoints), "viewpoint"), (len(graph.edges), "edge")):
                if f"{number:,} {noun}" not in summary:
                    self.fault(f"the status bar says {summary!r}, but there are {number} {noun}s")
            chosen = editing.selection
            if chosen.viewpoints - graph.viewpoints.keys() or chosen.edges - graph.edges.keys():
                self.fault("the selection has items that are not in the graph")
            if set(editing.proposals.doubted) - graph.edges.keys():
                self.fault("an edge that does not exist is doubted")
        history = editing.history
        for id, text in (("undo", history and history.undo_text), ("redo", history and history.redo_text)):
            action = window.actions_table[id]
            usable = bool(text) and editing.writable and document.page_frame is None
            if action.isEnabled() and not text and not window.focusWidget():
                self.fault(f"{id} is enabled without a step")
            if usable and len(action.text().replace("&", "")) <= len("Undo "):
                self.fault(f"{id} does not name its step")

    def _stale(self) -> None:
        for card in self.window.notice_area._cards:
            over = time.time() - card.notice.when
            if over > 3 * SECONDS[card.notice.severity] and not card.underMouse() and not card._timer.isActive():
                self.fault(f"a notice stays for {over:.0f} s: {card.notice.text}")
        project, state = self.document.project, self.window.part(FramePart).state
        panel = self.window.panels["frames"]
        if project is not None and panel.isVisible() and state.coverage:
            capture = self.document.contents.capture
            bare = [] if capture is None else [i for i in range(len(capture.frames)) if i not in state.coverage]
            if bare and len(list((project / "masks").glob("*"))) >= len(capture.frames):
                self.fault(f"{len(bare)} frames are listed without their mask")

    def _end_jobs(self) -> None:
        """Cancels jobs that have run for half a minute, and removes old ones."""
        now, jobs = time.monotonic(), self.window.jobs
        for handle in jobs.running:
            if now - self._jobs.setdefault(handle.number, now) > JOB:
                jobs.cancel(handle)
        for handle in [h for h in jobs.handles if h.state == "queued"][3:]:
            jobs.cancel(handle)

    # ----------------------------------------------------------------------------------------------------------------

    def figures(self) -> dict[str, object]:
        late = self.memory[len(self.memory) // 2 :]
        growth = float("nan")
        if len(late) > 3:
            t, m = np.array(late).T
            growth = 3600 * float(np.polyfit(t - t[0], m, 1)[0])
        return {
            "minutes": round((time.monotonic() - self.begun) / 60, 1),
            "events": self.events,
            "tests": self.tests,
            "faults": len(self.faults),
            "memory_first_mib": round(self.memory[0][1]) if self.memory else 0,
            "memory_half_mib": round(late[0][1]) if late else 0,
            "memory_last_mib": round(late[-1][1]) if late else 0,
            "memory_peak_mib": round(self.peak),
            "allocated_mib": round(heap_mib()),
            "growth_mib_per_hour": round(growth, 1),
            "actions": dict(self.counts.most_common()),
        }


def main() -> int:
    given = tyro.cli(Arguments, description=__doc__)
    with tempfile.TemporaryDirectory(prefix="nvsim-soak-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        demo = folder / "demo.nvsim"
        shutil.copytree(given.demo, demo)
        settings = QSettings(str(folder / "window.ini"), QSettings.Format.IniFormat)
        app = make_application("dark", settings)
        session = Session(settings)
        restore = install_excepthook(session.notices)
        collecting = Collecting(lambda: session.window.scene.drawing)
        session.document.projectLeft.connect(collecting.begin_anew)
        QDesktopServices.openUrl = lambda url: True  # type: ignore[method-assign, assignment]
        session.window.setGeometry(0, 0, 1280, 800)
        session.window.show()
        session.open(demo)
        files = [demo, demo]
        soak = Soak(session, files, given.minutes, given.seed)

        def hear(kind: QtMsgType, _: object, text: str) -> None:
            if kind != QtMsgType.QtDebugMsg and "propagateSizeHints" not in text:
                soak.fault(f"Qt: {text}")

        def begin() -> None:
            if session.document.graph is None:
                if time.monotonic() > soak.end:
                    app.exit()
                QTimer.singleShot(200, begin)
                return
            write_connectivity(session.document.graph, folder)
            files.extend(folder.glob("*_connectivity.json"))
            soak.step()

        qInstallMessageHandler(hear)
        QTimer.singleShot(0, begin)
        app.exec()
        if time.monotonic() < soak.end and not soak.faults:
            soak.fault("an action ended the program")
        qInstallMessageHandler(None)
        for handle in session.window.jobs.running:
            session.window.jobs.cancel(handle)
        until = time.monotonic() + 30
        while session.window.jobs.running and time.monotonic() < until:
            app.processEvents()
            time.sleep(0.05)
        session.close()
        collecting.stop()
        restore()
    report({"seed": given.seed, **soak.figures()}, given.json)
    for fault in soak.faults:
        print(fault)
    return 1 if soak.faults else 0


if __name__ == "__main__":
    sys.exit(main())
