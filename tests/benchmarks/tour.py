"""Perform tasks in a real window with mouse and keyboard, in several sizes and both themes.

python tests/benchmarks/tour.py DEMO.nvsim [--out FOLDER] [--only 1280x720] [--theme dark] [--tasks why]

It saves an image of the screen after every action, and prints a table of actions and seconds. If a task is stuck or
needs more actions than MOST, the exit code is 1. It needs xvfb-run and xdotool. DEMO comes from `nvsim demo` and is
copied. In the copy, edges are added and removed, so that there are false edges.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import tyro
from PySide6.QtCore import QObject, QPoint, QPointF, QSettings, Qt, QTimer, Signal
from PySide6.QtWidgets import QApplication, QTabBar, QWidget

from nvsim.occupancy.paths import segment_is_free
from nvsim.occupancy.types import FREE

Answer = TypeVar("Answer")
Screen = Literal["960x540", "1280x720", "1600x1000", "2560x1440@2x"]
Theme = Literal["dark", "light"]
SCREENS: dict[Screen, tuple[str, str]] = {
    "960x540": ("960x540", "1"),
    "1280x720": ("1280x720", "1"),
    "1600x1000": ("1600x1000", "1"),
    "2560x1440@2x": ("2560x1440", "2"),
}
MOST = {"false edge": 2, "viewpoint": 4, "prune": 4, "merge": 3, "why": 2, "threshold": 2}  # actions
PATIENCE = 180.0  # seconds after which a task counts as stuck
SETTLE = 0.6  # seconds between an action and its image


class Stuck(Exception):
    """The expected event that did not happen, as a sentence."""


class Gui(QObject):
    """Runs functions in the window's thread from another thread, also while a menu or a dialog is open."""

    _asked = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._asked.connect(self._answer, Qt.ConnectionType.QueuedConnection)

    def ask(self, question: Callable[[], Answer]) -> Answer:
        done, found = threading.Event(), []

        def answer() -> None:
            try:
                found.append((question(), None))
            except Exception as error:
                found.append((None, error))
            done.set()

        self._asked.emit(answer)
        if not done.wait(PATIENCE):
            raise Stuck("the window does not answer")
        if found[0][1] is not None:
            raise found[0][1]
        return found[0][0]

    def _answer(self, answer: Callable[[], None]) -> None:
        answer()


@dataclass
class Hand:
    """Mouse and keyboard of the X server. Positions are in pixels of a widget."""

    gui: Gui
    out: Path
    scale: float
    actions: int = 0
    task: str = ""
    said: list[str] = field(default_factory=list)

    def begin(self, task: str) -> None:
        self.task, self.actions = task, 0

    def until(self, what: str, is_so: Callable[[], Any], seconds: float = PATIENCE) -> Any:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = self.gui.ask(is_so)
            if found:
                return found
            time.sleep(0.05)
        raise Stuck(what)

    def click(self, what: str, widget: QWidget, at: QPoint | None = None, held: str = "") -> None:
        x, y = self._place(widget, at)
        keys = (["keydown", held], ["keyup", held]) if held else ([], [])
        self._do("mousemove", x, y, "sleep", "0.08", *keys[0], "click", "1", *keys[1])
        self._acted(what)

    def drag(self, what: str, widget: QWidget, start: QPoint, end: QPoint) -> None:
        (x, y), (u, v) = self._place(widget, start), self._place(widget, end)
        middle = str((int(x) + int(u)) // 2), str((int(y) + int(v)) // 2)
        press, step = ("mousemove", x, y, "sleep", "0.08", "mousedown", "1"), ("sleep", "0.08", "mousemove")
        self._do(*press, *step, *middle, *step, u, v, "sleep", "0.08", "mouseup", "1")
        self._acted(what)

    def type(self, what: str, text: str) -> None:
        self._do("type", "--delay", "20", text)
        self._acted(what)

    def wheel(self, what: str, widget: QWidget, at: QPoint) -> None:
        self._do("mousemove", *self._place(widget, at), "sleep", "0.05", "click", "4")
        self._acted(what)

    def press(self, what: str, keys: str) -> None:
        self._do("key", "--clearmodifiers", keys)
        self._acted(what)

    def give_keys(self, window: QWidget) -> None:
        """Gives keyboard focus to the window, because there is no window manager."""
        self._do("windowfocus", str(self.gui.ask(lambda: int(window.winId()))))

    def _place(self, widget: QWidget, at: QPoint | None) -> tuple[str, str]:
        def place() -> QPoint:
            if not widget.isVisible() or widget.visibleRegion().isEmpty():
                raise Stuck(f"{widget.objectName() or type(widget).__name__} is not visible")
            point = at if at is not None else widget.visibleRegion().boundingRect().center()
            return widget.mapToGlobal(point)

        found = self.gui.ask(place)
        return str(round(found.x() * self.scale)), str(round(found.y() * self.scale))

    def _do(self, *words: str) -> None:
        subprocess.run(["xdotool", *words], check=True, timeout=20, stderr=subprocess.DEVNULL)

    def _acted(self, what: str) -> None:
        self.actions += 1
        time.sleep(SETTLE)
        self.look(what)

    def look(self, what: str) -> None:
        """Saves an image of the screen."""
        name = "".join(c if c.isalnum() else "-" for c in what)[:40]
        path = self.out / f"{self.task}-{self.actions:02d}-{name}.png"
        self.gui.ask(lambda: QApplication.primaryScreen().grabWindow(0).save(str(path)))


class Tour:
    """The tasks. Everything that touches the window goes through `hand.gui`."""

    def __init__(self, session: Any, hand: Hand, demo: Path) -> None:
        self.session, self.window, self.hand = session, session.window, hand
        self.document, self.demo = session.document, demo

    def open(self, path: Path) -> None:
        hand, document = self.hand, self.document
        hand.gui.ask(lambda: self.session.open(path))
        hand.until("the project was not read", lambda: document.graph is not None)
        hand.until("nothing was drawn", lambda: self.window.scene.picture is not None)
        hand.until("the view did not stop drawing", lambda: not self.window.scene.drawing)
        time.sleep(2.0)
        hand.give_keys(self.window)
        hand.look("opened")

    def menu(self, name: str, entry: str) -> None:
        """Performs two clicks: on the menu, and on its entry."""
        hand, bar = self.hand, self.window.menuBar()

        def plain(text: str) -> str:
            return text.replace("&", "")

        title = hand.gui.ask(lambda: next(a for a in bar.actions() if plain(a.text()) == name))
        hand.click(f"menu {name}", bar, hand.gui.ask(lambda: bar.actionGeometry(title).center()))
        menu = hand.gui.ask(title.menu)
        hand.until(f"the menu {name} did not open", menu.isVisible)
        action = hand.gui.ask(lambda: next(a for a in menu.actions() if plain(a.text()).startswith(entry)))
        if not hand.gui.ask(action.isEnabled):
            raise Stuck(f"{entry} is disabled: {hand.gui.ask(action.toolTip)}")
        hand.click(entry, menu, hand.gui.ask(lambda: menu.actionGeometry(action).center()))

    def bring(self, title: str, panel: QWidget) -> None:
        """Shows a panel: clicks its tab if another panel covers it, or uses the Window menu if it is closed."""
        if self.hand.gui.ask(lambda: _is_seen(panel)):
            return

        def tab() -> tuple[QTabBar, QPoint] | None:
            for bar in self.window.findChildren(QTabBar):
                for i in range(bar.count()):
                    if bar.isVisible() and bar.tabText(i) == title and bar.rect().contains(bar.tabRect(i).center()):
                        return bar, bar.tabRect(i).center()
            return None

        found = self.hand.gui.ask(tab)
        if found is not None:
            self.hand.click(f"tab {title}", *found)
        else:
            self.menu("Window", title)
        self.hand.until(f"{title} did not appear", lambda: _is_seen(panel), 5)

    # Edits of the graph, in the workspace for them -----------------------------------------------------------------

    def begin_editing(self) -> Any:
        """Opens the project in the workspace Edit graph with nothing selected. Returns the surface of the map."""
        gui, table = self.hand.gui, self.window.actions_table
        if gui.ask(lambda: self.document.path) != self.demo:
            self.open(self.demo)
        gui.ask(lambda: self.document.editing.go_to(0))
        for id in ("workspace_edit", "mode_select", "select_none", "whole_map"):
            gui.ask(table[id].trigger)
        self.hand.give_keys(self.window)
        time.sleep(SETTLE)
        return gui.ask(lambda: self.window.modes.canvases[1].surface)

    def removes_a_false_edge(self) -> None:
        surface, gui, document = self.begin_editing(), self.hand.gui, self.document
        gui.ask(lambda: spoil(document))
        at, key = gui.ask(lambda: longest_edge(document, surface))
        self.hand.click("the edge", surface.widget, at)
        self.hand.press("remove it", "Delete")
        self.hand.until("the edge was not removed", lambda: key not in document.graph.edges, 5)

    def adds_a_viewpoint(self) -> None:
        surface, gui, document = self.begin_editing(), self.hand.gui, self.document
        before = gui.ask(lambda: set(document.graph.viewpoints))
        at = gui.ask(lambda: free_place(document, surface))
        self.hand.press("add viewpoints", "p")
        self.hand.click("a free place", surface.widget, at)
        new = self.hand.until("no viewpoint was added", lambda: set(document.graph.viewpoints) - before, 5)
        self.hand.until("no edge was proposed", lambda: document.editing.proposals.edges)
        self.hand.press("accept the proposed edges", "ctrl+Return")
        self.hand.until("the viewpoint has no edges", lambda: document.graph.neighbors(next(iter(new))), 5)

    def prunes(self) -> None:
        self.begin_editing()
        document = self.document
        degrees = self.hand.gui.ask(lambda: {id: degree(document, id) for id in document.graph.viewpoints})
        most = max(degrees.values())
        wanted = {id for id, value in degrees.items() if value == most}
        self.hand.press("select by expression", "ctrl+f")
        self.hand.type("an expression", f"degree > {most - 1}")
        self.hand.press("select", "Return")
        self.hand.press("remove them", "Delete")
        self.hand.until("they were not removed", lambda: not wanted & document.graph.viewpoints.keys(), 5)

    def merges(self) -> None:
        surface, document = self.begin_editing(), self.document
        a, b = self.hand.gui.ask(lambda: clickable_pair(document, surface))
        self._click_viewpoint("one viewpoint", surface, a)
        self._click_viewpoint("another viewpoint", surface, b, held="shift")
        self.hand.press("merge them", "ctrl+m")
        self.hand.until("they were not merged", lambda: len({a, b} & document.graph.viewpoints.keys()) < 2, 5)

    def asks_why(self) -> None:
        surface, document = self.begin_editing(), self.document
        self.hand.gui.ask(lambda: self.window.show_dock("details"))
        a, b = self.hand.gui.ask(lambda: clickable_pair(document, surface, joined=False))
        self._click_viewpoint("one viewpoint", surface, a)
        self._click_viewpoint("another viewpoint", surface, b, held="shift")
        words = self.window.panels["details"].words
        self.hand.until("the reason is not shown", lambda: "There is no edge" in words.text() and words.isVisible(), 5)
        self.hand.said.append(self.hand.gui.ask(words.text))

    def tries_a_threshold(self) -> None:
        from nvsim_app.wiring.thresholds import ThresholdPart

        self.begin_editing()
        panel, gui = self.window.panels["thresholds"], self.hand.gui
        trial = gui.ask(lambda: self.window.part(ThresholdPart).trial)
        self.bring("Thresholds", panel)
        slider = panel.rows["tau_alpha"].slider
        gui.ask(lambda: panel.ensureWidgetVisible(slider))
        y, share = gui.ask(lambda: (slider.height() // 2, slider.value() / slider.maximum()))
        start = QPoint(8 + round(share * (slider.width() - 16)), y)
        self.hand.drag("drag the slider", slider, start, QPoint(8, y))
        self.hand.until("the effect is not shown", lambda: trial.outcome is not None, 20)
        gui.ask(panel.reset.click)

    def _click_viewpoint(self, what: str, surface: Any, id: str, held: str = "") -> None:
        """Clicks a viewpoint. Zooms in while another viewpoint is at its pixel."""
        gui, document = self.hand.gui, self.document

        def pixel() -> QPoint:
            pixels, _ = surface.project(document.graph_arrays.feet[document.graph_arrays.index[id]][None])
            return QPointF(*pixels[0]).toPoint()

        for _ in range(12):
            at = gui.ask(pixel)
            if gui.ask(lambda at=at: surface.pick_viewpoint(QPointF(at)) == id):
                if not gui.ask(lambda at=at: surface.widget.rect().contains(at)):
                    raise Stuck(f"{what} is outside the map")
                self.hand.click(what, surface.widget, at, held=held)
                return
            self.hand.wheel("zoom in", surface.widget, at)
        raise Stuck(f"{what} cannot be clicked")


def _is_seen(panel: QWidget) -> bool:
    found = QApplication.widgetAt(panel.mapToGlobal(panel.rect().center())) if panel.isVisible() else None
    return found is not None and (found is panel or panel.isAncestorOf(found))


def spoil(document: Any) -> None:
    """Creates findings: adds edges between the two most distant pairs, and isolates two viewpoints."""
    arrays, graph = document.graph_arrays, document.graph
    far = sorted(((math.dist(p, q), i, j) for i, p in enumerate(arrays.feet) for j, q in enumerate(arrays.feet[:i])))
    pairs = [[arrays.ids[i], arrays.ids[j]] for _, i, j in far[-2:]]
    lonely = [id for id in arrays.ids if all(id not in pair for pair in pairs)][:2]
    cut = [list(key) for key in graph.edges if set(key) & set(lonely)]
    document.editing.run("add_edges", {"pairs": pairs})
    document.editing.run("remove_edges", {"pairs": cut})


def degree(document: Any, id: str) -> int:
    return len(document.graph.neighbors(id))


def longest_edge(document: Any, surface: Any) -> tuple[QPoint, tuple[str, str]]:
    """The pixel of the longest edge that the mouse hits only there, and its key."""
    arrays = document.graph_arrays
    edges = sorted(document.graph.edges, key=lambda key: -math.dist(*(arrays.feet[arrays.index[id]] for id in key)))
    for key in edges:
        ends, _ = surface.project(arrays.feet[[arrays.index[id] for id in key]])
        for share in (0.5, 0.4, 0.6, 0.3, 0.7):
            at = QPointF(*(ends[0] + share * (ends[1] - ends[0])))
            if surface.pick_viewpoint(at) is None and surface.pick_edge(at) == key:
                return at.toPoint(), key
    raise Stuck("no edge can be clicked")


def free_place(document: Any, surface: Any) -> QPoint:
    """The pixel farthest from walls on free floor, away from viewpoints, edges, and frames, with two viewpoints within
    2 m. A place at a wall can be free on the map and closed for the models."""
    found: list[tuple[float, int, int]] = []
    arrays, map = document.graph_arrays, document.contents.occupancy
    widget, around = surface.widget, 0.3 * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    for x in range(20, widget.width() - 20, 7):
        for y in range(20, widget.height() - 20, 7):
            at = QPointF(x, y)
            place = surface.floor_point(at)
            if place is None or surface.pick_viewpoint(at) or surface.pick_edge(at) or surface.pick_frame(at):
                continue
            near = sorted(arrays.feet, key=lambda foot: math.dist(place[:2], foot[:2]))[:2]
            far = [math.dist(place[:2], foot[:2]) for foot in near]
            free = (map.states_at(np.array(place[:2]) + around) == FREE).all()
            if (
                free
                and far[0] > 0.8
                and far[1] < 2.0
                and all(segment_is_free(map, place[:2], f[:2], 0.3) for f in near)
            ):
                column, row = ((np.array(place[:2]) - map.origin) / map.resolution).astype(int)
                found.append((float(map.room[row, column]), x, y))
    if not found:
        raise Stuck("there is no free place on the map")
    return QPoint(*max(found)[1:])


def clickable_pair(document: Any, surface: Any, joined: bool = True) -> tuple[str, str]:
    """Two viewpoints, joined by an edge or near each other without one, that the mouse hits at their pixels."""
    arrays, graph = document.graph_arrays, document.graph
    pixels, _ = surface.project(arrays.feet)
    hit = [i for i, p in enumerate(pixels) if surface.pick_viewpoint(QPointF(QPointF(*p).toPoint())) == arrays.ids[i]]
    pairs = [(math.dist(arrays.feet[i], arrays.feet[j]), i, j) for i in hit for j in hit if i < j]
    for length, i, j in sorted(pairs):
        a, b = sorted((arrays.ids[i], arrays.ids[j]))
        if ((a, b) in graph.edges) == joined and (joined or length > 1.5):
            return a, b
    raise Stuck("no two viewpoints can be clicked")


TASKS: dict[str, Callable[[Tour], None]] = {
    "false edge": Tour.removes_a_false_edge,
    "viewpoint": Tour.adds_a_viewpoint,
    "prune": Tour.prunes,
    "merge": Tour.merges,
    "why": Tour.asks_why,
    "threshold": Tour.tries_a_threshold,
}


@dataclass(frozen=True)
class Arguments:
    demo: tyro.conf.Positional[Path]
    out: Path = Path("tour")
    only: tuple[Screen, ...] = tuple(SCREENS)
    theme: tuple[Theme, ...] = ("dark", "light")
    tasks: tuple[str, ...] = tuple(TASKS)
    inside: bool = False
    """Perform the tasks on the current display. The processes of the windows are started with this option."""


def inside(given: Arguments) -> None:
    """Performs all tasks in one window on the current display, and prints a line of JSON for each."""
    from nvsim_app.session import Session
    from nvsim_app.start.application import make_application

    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="nvsim-tour-") as folder:
        demo = Path(folder, "demo.nvsim")
        shutil.copytree(given.demo, demo)
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        app = make_application(given.theme[0], settings)
        session = Session(settings)
        session.window.setGeometry(app.primaryScreen().geometry())
        session.window.show()
        hand = Hand(Gui(), given.out, session.window.devicePixelRatioF())
        tour = Tour(session, hand, demo)

        def work() -> None:
            for name in given.tasks:
                task = TASKS[name]
                hand.begin(name)
                hand.said.clear()
                begin, stuck = time.monotonic(), ""
                try:
                    task(tour)
                except Stuck as error:
                    stuck = str(error)
                except Exception:
                    stuck = traceback.format_exc().strip().splitlines()[-1]
                    traceback.print_exc()
                hand.look("end")
                seconds = time.monotonic() - begin
                row = {"task": name, "actions": hand.actions, "seconds": round(seconds, 1), "stuck": stuck}
                print(json.dumps(row | {"said": list(hand.said)}), flush=True)
                if stuck:
                    for _ in range(3):
                        subprocess.run(["xdotool", "key", "Escape"], check=False)
            hand.gui.ask(lambda: QTimer.singleShot(0, app.quit))

        worker = threading.Thread(target=work, daemon=True)
        QTimer.singleShot(500, worker.start)
        app.exec()
        session.close()


def main() -> None:
    given = tyro.cli(Arguments, description=__doc__)
    if given.inside:
        inside(given)
        return
    lines, good = [], True
    for screen in given.only:
        for theme in given.theme:
            size, factor = SCREENS[screen]
            out = given.out / f"{screen}-{theme}"
            words = [sys.executable, __file__, given.demo, "--out", out, "--theme", theme, "--inside"]
            words += ["--tasks", *given.tasks]
            environment = {**os.environ, "QT_SCALE_FACTOR": factor, "QT_QPA_PLATFORM": "xcb"}
            server = ["xvfb-run", "-a", "-s", f"-screen 0 {size}x24"]
            done = subprocess.run([*server, *map(str, words)], env=environment, stdout=subprocess.PIPE, text=True)
            for line in done.stdout.splitlines():
                row = json.loads(line)
                over = row["actions"] > MOST.get(row["task"], row["actions"])
                end = f"stuck: {row['stuck']}" if row["stuck"] else "too many actions" if over else "done"
                good = good and end == "done"
                named = f"{screen:12} {theme:6} {row['task']:10}"
                lines.append(f"{named} {row['actions']:3} {row['seconds']:6.1f}  {end}")
                print(lines[-1], *row["said"], sep="\n    ", flush=True)
    print("\nscreen       theme  task       actions seconds", *lines, sep="\n")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
