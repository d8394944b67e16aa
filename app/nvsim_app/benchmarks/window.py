"""The main benchmark of the window: start time, gaps of the event loop during a flight, frame rate, time to a sharp
image, and the frame rates of both views of the graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from math import sin, tau

import psutil
from PySide6.QtCore import QObject, Qt, QTimer, Signal

from nvsim_app.benchmarks.graphs import graph_views
from nvsim_app.drawing.render_child import Picture
from nvsim_app.painting import cameras
from nvsim_app.session import Session

INTERVAL = 5  # milliseconds


class GapRecorder(QObject):
    """Records the gaps between ticks in milliseconds. In an idle loop they are about INTERVAL."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.gaps: list[float] = []
        self._last = 0.0
        self._timer = QTimer(self, interval=INTERVAL)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)

    def start(self) -> None:
        """Starts a measurement and clears the recorded gaps."""
        self.gaps = []
        self._last = time.perf_counter()
        self._timer.start()

    def stop(self) -> None:
        self._timer.stop()

    @property
    def longest(self) -> float:
        return max(self.gaps, default=0.0)

    def quantile(self, share: float) -> float:
        """The gap that `share` (0 to 1) of all gaps do not exceed."""
        ordered = sorted(self.gaps)
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0

    def _tick(self) -> None:
        now = time.perf_counter()
        self.gaps.append(1e3 * (now - self._last))
        self._last = now


FIRST = 10.0  # seconds after opening, within which the view should move smoothly
LAST_OF_FIRST = 4.0  # seconds at their end, in which the frame rate is measured
SIZE = (1280, 720)  # of the 3D view, in pixels
FLIGHT = 8.0  # seconds
RESTS = 7  # number of times that the camera comes to rest
UNTRAINED = 8.0  # seconds after the trajectory or graph appeared, until a project counts as having no models
PATIENCE = 180.0  # seconds until the reconstruction must be visible

KEYS = ("start_s", "gap_p99_ms", "gap_max_ms", "first_fps_moving", "fps_moving", "sharp_ms", "rss_mb")
Wait = float | Callable[[], bool]  # seconds, or a condition
Figures = dict[str, float | str | None]


class WindowBenchmark(QObject):
    """Runs the benchmark.

    finished(dict): start_s, start_cpu_s (CPU seconds until then), gap_p99_ms, gap_max_ms, first_fps_moving, fps_moving,
    sharp_ms, rss_mb, window_mb, and other figures; None for figures that the project does not support.
    failed(): an error stopped the benchmark.

    cycles   how often the project is closed and opened again, to measure the growth of memory
    """

    finished = Signal(dict)
    failed = Signal()

    def __init__(self, session: Session, cycles: int = 0) -> None:
        super().__init__(session)
        self._session, self._cycles = session, cycles
        self._scene = session.window.scene
        self._probe = GapRecorder(self)
        self._shown: list[tuple[float, Picture]] = []
        self.figures: Figures = dict.fromkeys(KEYS)
        self._scene.pictureShown.connect(lambda p: self._shown.append((time.perf_counter(), p)))
        self._steps = self._script()
        self._wait: Wait = 0.0
        self._since = 0.0
        self._timer = QTimer(self, interval=2)
        self._timer.timeout.connect(self._go_on)

    def start(self) -> None:
        """Must be called before the event loop runs."""
        QTimer.singleShot(0, self._on_usable)

    def _on_usable(self) -> None:
        me = psutil.Process()
        self.figures["start_s"] = round(time.time() - me.create_time(), 3)
        self.figures["start_cpu_s"] = round(sum(me.cpu_times()[:2]), 3)
        self._since = time.perf_counter()
        self._timer.start()

    def _go_on(self) -> None:
        wait, elapsed = self._wait, time.perf_counter() - self._since
        if wait() if callable(wait) else elapsed >= wait:
            try:
                self._wait = next(self._steps)
            except StopIteration:
                self._finish()
            except Exception:
                self._stop()
                self.failed.emit()
                raise
            self._since = time.perf_counter()
        elif callable(wait) and elapsed > PATIENCE:
            self._finish()

    def _stop(self) -> None:
        self._timer.stop()
        self._probe.stop()

    def _finish(self) -> None:
        self._stop()
        self.finished.emit(self.figures)

    # Steps ---------------------------------------------------------------------------------------------------------

    def _script(self) -> Iterator[Wait]:
        # The measurement includes reading the project and starting the render process.
        self._probe.start()
        document = self._session.document
        if document.path is None:
            yield 1.0
            self._note_gaps()
            self._note_memory()
            return
        opened = time.perf_counter()
        yield lambda: document.extent.size > 0
        begin = time.perf_counter()
        self._fit()
        yield lambda: document.contents.scene_stamp is not None or time.perf_counter() - begin > UNTRAINED
        if document.contents.scene_stamp is not None:
            yield from self._fly_first(opened + FIRST)
        # A project may have neither models nor a map.
        yield lambda: document.contents.occupancy is not None or time.perf_counter() - begin > UNTRAINED
        if document.contents.scene_stamp is None:
            self._note_gaps()
            self._note_memory()
            return
        yield lambda: self._scene.picture is not None
        for layer in self._scene.overlays.layers:
            self._scene.overlays.set_shown(layer.name, True)
        yield 1.0
        yield lambda: not self._scene.drawing
        yield from self._fly()
        self._note_gaps()
        yield from self._measure_rest()
        yield from self._visit()
        self._note_memory()
        yield from graph_views(self._session.window, self.figures)
        if self._cycles:
            yield from self._open_and_close()

    def _fit(self) -> None:
        """Resizes the window, so that the 3D view has the size SIZE."""
        window, scene = self._session.window, self._scene
        window.resize(window.width() + SIZE[0] - scene.width(), window.height() + SIZE[1] - scene.height())

    def _fly_first(self, end: float) -> Iterator[Wait]:
        """Flies until `end`, like an impatient user. Measures the frame rate of the last seconds; without an image, it
        is 0."""
        self._shown.clear()
        yield from self._fly_until(end)
        counted = [at for at, picture in self._shown if picture.request.moving and end - at < LAST_OF_FIRST]
        self.figures["first_fps_moving"] = round(len(counted) / LAST_OF_FIRST, 1)
        yield lambda: self._scene.picture is not None and not self._scene.drawing  # until the window is fully loaded

    def _fly_until(self, end: float) -> Iterator[Wait]:
        home, navigation, begin = self._scene.pose, self._scene.navigation, time.perf_counter()
        while time.perf_counter() < end:
            seconds = time.perf_counter() - begin
            pose = cameras.turn_pose(home, tau * seconds / FLIGHT, 0.15 * sin(seconds))
            navigation.set_pose(cameras.fly_pose(pose, 0.5 * sin(seconds), 0.0, 0.0))
            yield 0.012
        navigation.set_pose(home)

    def _fly(self) -> Iterator[Wait]:
        self._shown.clear()
        begin = time.perf_counter()
        yield from self._fly_until(begin + FLIGHT)
        seconds = time.perf_counter() - begin
        moving = [picture for _, picture in self._shown if picture.request.moving]
        self.figures["fps_moving"] = round(len(moving) / seconds, 1)
        if moving:
            widths = sorted(p.request.camera.intrinsics.width for p in moving)
            self.figures["moving_width"] = widths[len(widths) // 2]

    def _measure_rest(self) -> Iterator[Wait]:
        times: list[float] = []
        for _ in range(RESTS):
            yield 0.15
            self._shown.clear()
            self._scene.navigation.set_pose(cameras.turn_pose(self._scene.pose, 0.05, 0.0))
            begin = time.perf_counter()
            yield lambda: any(not picture.request.moving for _, picture in self._shown)
            times += [1e3 * (at - begin) for at, picture in self._shown if not picture.request.moving][:1]
        k = self._scene.picture.request.camera.intrinsics if self._scene.picture else None
        self.figures["sharp_ms"] = round(sorted(times)[len(times) // 2], 1)
        self.figures["sharp_size"] = f"{k.width}x{k.height}" if k else None
        self.figures["renderer"] = self._scene.picture.renderer if self._scene.picture else None

    def _visit(self) -> Iterator[Wait]:
        """Visits every submap once, so that all models that stay in memory are loaded."""
        for submap in self._session.document.contents.submaps:
            self._shown.clear()
            x, y, z = (float(v) for v in submap.positions[len(submap.positions) // 2])
            self._scene.navigation.set_pose(cameras.ViewPose((x, y, z)))
            yield lambda: any(not picture.request.moving for _, picture in self._shown)

    def _open_and_close(self) -> Iterator[Wait]:
        path = self._session.document.path
        assert path is not None
        me = psutil.Process()
        early = 0.0
        for cycle in range(self._cycles):
            self._session.close_project()
            yield lambda: self._session.document.path is None
            self._session.open(path)
            yield lambda: self._scene.picture is not None
            self._shown.clear()  # otherwise the images stored here would count as memory of the window
            if cycle == min(5, self._cycles // 2):
                early = me.memory_info().rss  # permanent caches are filled by now
        self.figures["cycles"] = self._cycles
        self.figures["growth_mb"] = round((me.memory_info().rss - early) / 2**20, 1)

    def _note_gaps(self) -> None:
        self._probe.stop()
        self.figures["gap_p99_ms"] = round(self._probe.quantile(0.99), 1)
        self.figures["gap_max_ms"] = round(self._probe.longest, 1)

    def _note_memory(self) -> None:
        me = psutil.Process()
        own, children = me.memory_info().rss, me.children(recursive=True)
        self.figures["window_mb"] = round(own / 2**20)
        self.figures["rss_mb"] = round((own + sum(p.memory_info().rss for p in children)) / 2**20)
