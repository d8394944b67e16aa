"""Measure which gesture in the window makes its memory grow.

xvfb-run -a -s "-screen 0 1280x800x24" python tests/benchmarks/gesture_memory.py DEMO.nvsim [--gestures select edit]

Each gesture is repeated with real mouse and keyboard events in a new window on a copy of DEMO, which comes from
`nvsim demo`. After repetitions that fill the caches, the benchmark counts at the start, in the middle, and at the end:

- RSS of the window, in MiB;
- QObjects by class, of all windows and of the application;
- Python objects by type, after all garbage is collected, and the garbage that the window had not collected.

It prints the growth of the two halves per 100 repetitions. A leak grows equally in both. Each count creates a few Qt
objects itself: Counter, Count, QObject, QTextFrame, QTextTable, and QToolButton.
"""

from __future__ import annotations

import gc
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import tyro
from harness import report
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPoint, QPointF, QSettings, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QMenu, QSlider, QWidget

from nvsim.graph.connectivity import write_connectivity
from nvsim_app.session import Session
from nvsim_app.start.application import Collecting, make_application

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
NONE = Qt.KeyboardModifier.NoModifier
PAUSE = 40  # milliseconds between two events
LIMIT = 60.0  # seconds to wait for a project
NAMED = 12  # types that are printed
SHARES = {
    "rest": 1.0, "select": 2.0, "hover": 2.0, "camera": 1.0, "map": 1.0, "frames": 1.0, "frame_page": 0.5,
    "workspaces": 1.0, "edit": 1.0, "colors": 1.0, "inspect": 0.5, "modes": 1.0, "menus": 1.0, "dialogs": 0.5,
    "theme": 0.25, "save": 0.5, "open": 0.15, "keep_edits": 1.0, "thresholds": 1.0, "resize": 0.5, "graph_file": 0.15,
}  # fmt: skip
"""The gestures, and their shares of --repetitions."""


@dataclass(frozen=True)
class Arguments:
    """demo: a project of `nvsim demo`. gestures: all by default. repetitions: per half."""

    demo: tyro.conf.Positional[Path]
    gestures: tuple[str, ...] = ()
    repetitions: int = 100
    json: bool = False


@dataclass(frozen=True)
class Count:
    """The memory of the window in MiB, garbage that was not collected, QObjects by class, Python objects by type."""

    rss: float
    garbage: int
    qobjects: Counter[str]
    objects: Counter[str]


class Gestures:
    """The gestures by name. Each takes the number of the repetition."""

    def __init__(self, session: Session, files: list[Path]) -> None:
        self.session, self.window, self.files = session, session.window, files

    def make(self, name: str, i: int) -> None:
        """Makes the gesture `name` for the time `i`."""
        getattr(self, name)(i)

    def rest(self, i: int) -> None:
        QTest.qWait(4 * PAUSE)

    def trigger(self, *names: str) -> None:
        for name in names:
            self.window.actions_table[name].trigger()
            QTest.qWait(PAUSE)

    def views(self) -> list[QWidget]:
        """The 3D view and the map, as far as they are shown."""
        return [c.surface.widget for c in self.window.modes.canvases if c.surface.widget.isVisible()]

    def viewpoint(self, i: int) -> tuple[QWidget, QPoint]:
        """A view and the pixel of one viewpoint in it, or its center if no viewpoint is visible."""
        shown = [c.surface for c in self.window.modes.canvases if c.surface.widget.isVisible()]
        surface = shown[i % len(shown)]
        feet = np.asarray(self.session.document.graph_arrays.feet)
        pixels, depths = surface.project(feet)
        seen = pixels[(depths > 0) & ((pixels > 0) & (pixels < surface.widget.size().toTuple())).all(axis=1)]
        at = QPointF(*seen[i % len(seen)].tolist()).toPoint() if len(seen) else surface.widget.rect().center()
        return surface.widget, at

    def select(self, i: int) -> None:
        view, at = self.viewpoint(i)
        QTest.mouseMove(view, at)
        QTest.mouseClick(view, LEFT, NONE, at)
        QTest.qWait(PAUSE)

    def select_on_map(self, i: int) -> None:
        """The map shows every viewpoint, and the 3D view possibly none. Raises RuntimeError if none is selected."""
        self.select(2 * i + 1)
        if not self.session.document.editing.selection.viewpoints:
            raise RuntimeError("the click selected no viewpoint")

    def hover(self, i: int) -> None:
        view, at = self.viewpoint(i)
        QTest.mouseMove(view, at)
        QTest.qWait(PAUSE)

    def camera(self, i: int) -> None:
        self._drag(self.views()[0], RIGHT if i % 2 else LEFT)
        self._wheel(self.views()[0], i)

    def map(self, i: int) -> None:
        self._drag(self.views()[-1], RIGHT)
        self._wheel(self.views()[-1], i)

    def _drag(self, view: QWidget, button: Qt.MouseButton) -> None:
        center = view.rect().center()
        QTest.mousePress(view, button, NONE, center)
        for x in (5, 10, 20, 40):
            QTest.mouseMove(view, center + QPoint(x, x // 2))
            QTest.qWait(PAUSE)
        QTest.mouseRelease(view, button, NONE, center + QPoint(40, 20))

    def _wheel(self, view: QWidget, i: int) -> None:
        at, turn = QPointF(view.rect().center()), 120 if i % 2 else -120
        event = QWheelEvent(at, view.mapToGlobal(at), QPoint(), QPoint(0, turn), Qt.MouseButton.NoButton, NONE,
                            Qt.ScrollPhase.NoScrollPhase, False)  # fmt: skip
        QApplication.sendEvent(view, event)
        QTest.qWait(PAUSE)

    def frames(self, i: int) -> None:
        self.trigger("next_frame" if i % 40 < 20 else "previous_frame")

    def frame_page(self, i: int) -> None:
        self.trigger("next_frame" if i % 40 < 20 else "previous_frame", "open_frame")
        QTest.qWait(4 * PAUSE)
        self.trigger("frame_wipe", "frame_photo", "leave_frame")

    def workspaces(self, i: int) -> None:
        self.trigger(("workspace_explore", "workspace_train", "workspace_edit", "workspace_compare")[i % 4])
        QTest.qWait(2 * PAUSE)

    def edit(self, i: int) -> None:
        self.select_on_map(i)
        self.trigger("remove", "undo")
        QTest.qWait(PAUSE)

    def colors(self, i: int) -> None:
        self.trigger(("color_degree", "color_evidence", "color_component", "color_plain")[i % 4])

    def inspect(self, i: int) -> None:
        self.select_on_map(i)
        self.trigger("inspect")
        QTest.qWait(2 * PAUSE)

    def modes(self, i: int) -> None:
        self.trigger(("mode_measure", "mode_add_viewpoint", "mode_agent", "mode_add_edge", "mode_select")[i % 5])
        self.hover(i)

    def menus(self, i: int) -> None:
        bar = self.window.menuBar()
        titles = [a for a in bar.actions() if a.isVisible() and a.menu() is not None]
        QTest.mouseClick(bar, LEFT, NONE, bar.actionGeometry(titles[i % len(titles)]).center())
        QTest.qWait(PAUSE)
        self._escape()
        view, at = self.viewpoint(i)
        QTest.mouseClick(view, RIGHT, NONE, at)
        QTest.qWait(PAUSE)
        self._escape()

    def dialogs(self, i: int) -> None:
        self.trigger(("preferences", "about", "palette", "job_train", "help_keys", "export_scan", "help")[i % 7])
        QTest.qWait(2 * PAUSE)
        self._escape()

    def _escape(self) -> None:
        """Closes menus and dialogs."""
        for _ in range(4):
            open_now = [w for w in QApplication.topLevelWidgets() if isinstance(w, QDialog | QMenu) and w.isVisible()]
            popup = QApplication.activePopupWidget() or (open_now[-1] if open_now else None)
            if popup is None:
                return
            QTest.keyClick(popup, Qt.Key.Key_Escape)
            QTest.qWait(PAUSE)

    def theme(self, i: int) -> None:
        self.trigger("dark")
        QTest.qWait(4 * PAUSE)

    def save(self, i: int) -> None:
        self.select_on_map(i // 2)
        self.trigger("include" if i % 2 else "exclude", "save")
        QTest.qWait(4 * PAUSE)

    def open(self, i: int) -> None:
        self.session.open(self.files[i % len(self.files)])
        wait_for_project(self.session)

    def keep_edits(self, i: int) -> None:
        """Edits that are not undone; each becomes a step of the history."""
        self.select_on_map(i // 2)
        self.trigger("include" if i % 2 else "exclude")

    def thresholds(self, i: int) -> None:
        if i == 0:
            self.trigger("thresholds")
        sliders = [w for w in self.window.panels["thresholds"].findChildren(QSlider) if w.isEnabled()]
        QTest.keyClick(sliders[i // 2 % len(sliders)], Qt.Key.Key_Left if i % 2 else Qt.Key.Key_Right)
        QTest.qWait(3 * PAUSE)

    def resize(self, i: int) -> None:
        self.window.resize(*((960, 540), (1280, 720), (1280, 800), (1100, 640))[i % 4])
        QTest.qWait(4 * PAUSE)

    def graph_file(self, i: int) -> None:
        """Opens a connectivity file and the project in turn."""
        if i % 2 == 0:
            self.open(0)
            return
        assert self.session.document.graph is not None
        self.session.open(write_connectivity(self.session.document.graph, self.files[0].parent))
        wait_for_project(self.session, rendered=False)


def wait_for_project(session: Session, rendered: bool = True) -> None:
    """Waits until the graph, and the first image if one is rendered, are shown. Raises TimeoutError after a minute."""
    end = time.monotonic() + LIMIT
    while session.document.graph is None or (rendered and session.window.scene.picture is None):
        if time.monotonic() > end:
            raise TimeoutError("the project did not open")
        QTest.qWait(100)
    QTest.qWait(500)


def count_objects() -> Count:
    QTest.qWait(2000)
    for _ in range(3):
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        QTest.qWait(1)
    rss = psutil.Process().memory_info().rss / 2**20
    gc.unfreeze()
    garbage = gc.collect()
    gc.collect()
    qobjects: Counter[str] = Counter()
    app = QApplication.instance()
    roots = {id(w): w for w in QApplication.topLevelWidgets() if w.parent() is None}
    for root in (app, *roots.values()):
        qobjects.update(child.metaObject().className() for child in root.findChildren(QObject))
        qobjects[root.metaObject().className()] += 1
    objects = Counter(f"{type(o).__module__}.{type(o).__qualname__}" for o in gc.get_objects())
    gc.freeze()
    return Count(rss, garbage, qobjects, objects)


def growth(counts: list[Count], repetitions: int) -> dict[str, object]:
    """The growth of both halves per 100 repetitions."""
    factor, figures = 100 / repetitions, dict[str, object]()
    pairs = list(zip(counts, counts[1:]))
    figures["repetitions"] = 2 * repetitions
    figures["rss_mib"] = [round(counts[0].rss), round(counts[-1].rss)]
    figures["rss_mib_per_100"] = [round(factor * (b.rss - a.rss), 2) for a, b in pairs]
    figures["garbage_per_100"] = [round(factor * b.garbage) for _, b in pairs]
    for name in ("qobjects", "objects"):
        found = [getattr(c, name) for c in counts]
        figures[f"{name}_per_100"] = [round(factor * (b.total() - a.total())) for a, b in zip(found, found[1:])]
        first, last = (Counter(b) for b in found[1:])
        last.subtract(found[1])
        first.subtract(found[0])
        rows = [(kind, first[kind], more) for kind, more in last.most_common(NAMED) if more > 0 and first[kind] > 0]
        figures[f"growing_{name}"] = {kind: [round(factor * a), round(factor * b)] for kind, a, b in rows}
    return figures


def measure(demo: Path, name: str, repetitions: int) -> dict[str, object]:
    """The growth of one gesture in this process."""
    with tempfile.TemporaryDirectory(prefix="nvsim-gestures-", ignore_cleanup_errors=True) as folder:
        files = [Path(folder) / f"{k}.nvsim" for k in ("first", "second")]
        for file in files:
            shutil.copytree(demo, file)
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        make_application("dark", settings)
        session = Session(settings)
        collecting = Collecting(lambda: session.window.scene.drawing)
        session.document.projectLeft.connect(collecting.begin_anew)
        session.window.setGeometry(0, 0, 1280, 800)
        session.window.show()
        session.open(files[0])
        wait_for_project(session)
        gestures = Gestures(session, files)
        count = max(4, round(SHARES[name] * repetitions))
        for i in range(count):
            gestures.make(name, i)
        count_objects()
        counts = [count_objects()]
        for half in range(2):
            for i in range(count):
                gestures.make(name, (half + 1) * count + i)
            counts.append(count_objects())
        session.close()
        collecting.stop()
    return growth(counts, count)


def main() -> int:
    given = tyro.cli(Arguments, description=__doc__)
    if len(given.gestures) == 1:
        report(measure(given.demo, given.gestures[0], given.repetitions), given.json)
        sys.stdout.flush()
        os._exit(0)  # the interpreter's own exit is not measured
    found = {}
    for name in given.gestures or SHARES:
        words = [sys.executable, "-P", __file__, str(given.demo), "--gestures", name, "--json"]
        words += ["--repetitions", str(given.repetitions)]
        out = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout
        found[name] = json.loads(out.splitlines()[-1])
        print(name, json.dumps(found[name]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
