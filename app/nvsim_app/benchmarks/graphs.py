"""Benchmarks on a large graph: the frame rates of the 3D view and the map while the graph is panned, zoomed, and
hovered over, and the time of a single edit until both views have painted it with everything visible.

The time of an edit includes the operation, history, difference, findings, and all painting. The benchmark also measures
how long the event loop is blocked afterward, while the panels update.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPointF, QSettings, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget

from nvsim.benchmarks.graph import random_graph, random_map
from nvsim_app.look.notices import Notices
from nvsim_app.painting import cameras
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.checking import CheckPart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow

SECONDS = 1.5  # per measurement


def graph_views(window: MainWindow, figures: dict[str, float | str | None]) -> Iterator[float]:
    """Adds scene_pan_fps, scene_hover_fps, map_pan_fps, map_zoom_fps, and map_hover_fps to `figures`.

    The 3D view draws no reconstruction during these measurements. Yields seconds to wait.
    """
    scene, document = window.scene, window.document
    plan = window.part(MapPart).view
    if not document.graph_arrays.ids:
        return
    for layer in scene.overlays.layers:
        scene.overlays.set_shown(layer.name, layer.name in ("graph", "labels", "trajectory"))
    scene.feed.show(None)
    scene.navigation.set_pose(cameras.overview(document.extent))
    plan.frame_everything()
    yield 0.3

    def pan_scene(step: int) -> None:
        scene.navigation.set_pose(cameras.turn_pose(scene.pose, 0.01 if step % 60 < 30 else -0.01, 0.0))
        scene.repaint()

    figures["scene_pan_fps"] = _rate(pan_scene)
    yield 0.1
    figures["scene_hover_fps"] = _rate(lambda step: _hover(scene, step))
    yield 0.1
    box = plan.plot.getViewBox()

    def pan_map(step: int) -> None:
        box.translateBy(x=0.3 if step % 60 < 30 else -0.3, y=0.0)
        plan.canvas.repaint()

    def zoom_map(step: int) -> None:
        box.scaleBy((0.98, 0.98) if step % 60 < 30 else (1 / 0.98, 1 / 0.98))
        plan.canvas.repaint()

    figures["map_pan_fps"] = _rate(pan_map)
    yield 0.1
    figures["map_zoom_fps"] = _rate(zoom_map)
    yield 0.1
    plan.frame_everything()
    yield 0.2
    figures["map_hover_fps"] = _rate(lambda step: _hover(plan.canvas, step))


def _rate(do: Callable[[int], None]) -> float:
    """Calls per second, at the median duration."""
    times: list[float] = []
    begin = time.perf_counter()
    while time.perf_counter() - begin < SECONDS:
        before = time.perf_counter()
        do(len(times))
        # Both views follow a change of one of them.
        QCoreApplication.processEvents()
        times.append(time.perf_counter() - before)
    return round(1 / sorted(times)[len(times) // 2], 1)


def _hover(widget: QWidget, step: int) -> None:
    width, height = widget.width(), widget.height()
    place = QPointF(width * (0.1 + 0.8 * ((7 * step) % 101) / 101), height * (0.5 + 0.3 * ((3 * step) % 53) / 53))
    none = Qt.MouseButton.NoButton
    event = QMouseEvent(
        QEvent.Type.MouseMove, place, widget.mapToGlobal(place), none, none, Qt.KeyboardModifier.NoModifier
    )
    QCoreApplication.sendEvent(widget, event)
    widget.repaint()  # even if the viewpoint under the pointer is unchanged, so that the figure includes painting


SIZE = (1600, 1000)  # of the window, in pixels
LISTS = ("tables", "histogram", "validation", "history")
CATCH_UP = 0.3  # seconds after an edit in which the panels update
SETTLE = 1.5  # seconds until everything is painted and the first findings exist
PATIENCE = 60.0  # seconds


def measure(settings: QSettings, edits: int = 120, viewpoints: int = 10_000, seed: int = 0) -> dict[str, float]:
    """Times random edits of a random graph. Returns milliseconds:

    paint_p95_ms, paint_median_ms       from an edit until both views have painted it
    painted_edit_p95_ms                 the part of it before painting
    lists_paint_p95_ms                  like paint_p95_ms, with tables, histogram, findings, and history visible
    lists_turn_p95_ms, lists_turn_max_ms  the longest turn of the event loop after an edit, with these panels visible
    findings_first_ms                   from opening the graph until the list shows its findings
    findings_p95_ms, findings_max_ms    from an edit until the list shows the findings of the edited graph
    """
    document = Document()
    window = MainWindow(document, settings, Notices())
    window.resize(*SIZE)
    window.show()
    graph = random_graph(viewpoints, directions=8, seed=seed)
    begin = time.perf_counter()
    document.set_contents(Contents(Path("field.nvsim"), graph=graph, occupancy=random_map(graph, seed)))
    plan, findings = window.part(MapPart).view, window.part(CheckPart).panel
    views = PaintRecorder([window.scene, plan.canvas])
    show_lists(window)
    run_event_loop(lambda: not findings.pending)
    first = 1e3 * (time.perf_counter() - begin)
    for name in LISTS:
        window.docks[name].hide()
    run_event_loop(lambda: True, SETTLE)
    for layer in window.scene.overlays.layers:
        window.scene.overlays.set_shown(layer.name, True)
    window.scene.places.show_overview()
    plan.frame_everything()
    run_event_loop(lambda: True, SETTLE)
    rng = random.Random(seed)
    alone = [_single(document, views, rng, lambda: run_event_loop(lambda: True, 0.02)) for _ in range(edits)]
    show_lists(window)
    run_event_loop(lambda: True, SETTLE)
    listed: list[float] = []

    def catch_up() -> float:
        before = time.perf_counter()
        longest = run_event_loop(lambda: not findings.pending)
        listed.append(1e3 * (time.perf_counter() - before))
        return max(longest, run_event_loop(lambda: True, CATCH_UP))

    beside = [_single(document, views, rng, catch_up) for _ in range(edits // 2)]
    checked = [t.painted + more for t, more in zip(beside, listed, strict=True)]
    document.editing.close()
    window.close()
    return {
        "paint_p95_ms": _p95([t.painted for t in alone]),
        "paint_median_ms": round(float(np.median([t.painted for t in alone])), 1),
        "painted_edit_p95_ms": _p95([t.edited for t in alone]),
        "lists_paint_p95_ms": _p95([t.painted for t in beside]),
        "lists_turn_p95_ms": _p95([t.turn for t in beside]),
        "lists_turn_max_ms": round(max(t.turn for t in beside), 1),
        "findings_first_ms": round(first, 1),
        "findings_p95_ms": _p95(checked),
        "findings_max_ms": round(max(checked), 1),
    }


def run_event_loop(done: Callable[[], bool], least: float = 0.0) -> float:
    """Runs the event loop for at least `least` seconds and until `done`. Returns the longest turn in milliseconds.

    Raises TimeoutError if `done` does not become true in time.
    """
    longest, begin = 0.0, time.perf_counter()
    while (now := time.perf_counter()) - begin < least or not done():
        if now - begin > least + PATIENCE:
            raise TimeoutError("the benchmark waited too long for the window")
        QApplication.processEvents()
        longest = max(longest, time.perf_counter() - now)
        time.sleep(0.001)
    return 1e3 * longest


class PaintRecorder(QObject):
    """Records which of some widgets were painted since `clear`."""

    def __init__(self, widgets: Sequence[QWidget]) -> None:
        super().__init__()
        self._count, self._painted = len(widgets), set[int]()
        for widget in widgets:
            widget.installEventFilter(self)

    def clear(self) -> None:
        self._painted.clear()

    @property
    def all(self) -> bool:
        return len(self._painted) == self._count

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint:
            self._painted.add(id(watched))
        return False


class _Times:
    """Milliseconds since the start of one edit."""

    edited = painted = turn = 0.0


def _single(document: Document, views: PaintRecorder, rng: random.Random, after: Callable[[], float]) -> _Times:
    """Runs one edit that changes the graph, and times it. `after` runs the event loop after it was painted, and returns
    the longest turn in milliseconds."""
    times, editing, limit = _Times(), document.editing, time.perf_counter() + PATIENCE
    while time.perf_counter() < limit:
        name, arguments = random_edit(document, rng)
        views.clear()
        begin = time.perf_counter()
        if not editing.run(name, arguments):
            continue
        times.edited = 1e3 * (time.perf_counter() - begin)
        while not views.all:
            QApplication.processEvents()
            if time.perf_counter() > limit:
                raise TimeoutError("an edit was not painted")
        times.painted = 1e3 * (time.perf_counter() - begin)
        times.turn = after()
        return times
    raise TimeoutError("no edit was possible")


def random_edit(document: Document, rng: random.Random) -> tuple[str, dict[str, Any]]:
    """Name and arguments of a random operation on one viewpoint or edge."""
    graph = document.graph
    assert graph is not None
    id = rng.choice(list(graph.viewpoints))
    near = rng.choice(graph.neighbors(id) or (id,))
    x, y, z = graph.viewpoints[id].position
    kinds: list[tuple[str, dict[str, Any]]] = [
        ("shift_viewpoints", {"ids": [id], "by": [0.2, 0.1, 0.0]}),
        ("remove_viewpoints", {"ids": [id]}),
        ("remove_edges", {"pairs": [[id, near]]}),
        ("include", {"ids": [id], "included": False}),
        ("add_viewpoint", {"position": [x + 0.7, y + 0.7, z]}),
        ("split_edge", {"edge": [id, near]}),
        ("merge_viewpoints", {"ids": [id, near], "middle": True}),
    ]
    return rng.choice(kinds)


def show_lists(window: MainWindow) -> None:
    """Shows all panels that follow the graph, side by side."""
    for name in LISTS:
        window.show_dock(name)
    area = Qt.DockWidgetArea.BottomDockWidgetArea
    window.addDockWidget(area, window.docks["histogram"], Qt.Orientation.Horizontal)


def _p95(values: list[float]) -> float:
    return round(float(np.percentile(values, 95)), 1)
