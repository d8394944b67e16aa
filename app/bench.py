"""The window measures itself: time to start, gaps of the event loop while the camera flies, pace, time to sharpness."""

from __future__ import annotations

import time
from math import sin, tau

import psutil
from PySide6.QtCore import QObject, QTimer, Signal

from app import cameras
from app.render_child import Picture
from app.responsiveness import Probe
from app.session import Session

FLIGHT = 6.0  # seconds
RESTS = 5  # times the camera comes to rest
PATIENCE = 120.0  # seconds until the reconstruction must be there


class Bench(QObject):
    """finished(dict): start_s, gap_p99_ms, gap_max_ms, fps_moving, sharp_ms, rss_mb, renderer."""

    finished = Signal(dict)

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._session = session
        self._scene = session.window.scene
        self._probe = Probe(self)
        self._figures: dict[str, float | None] = {}
        self._begin = time.perf_counter()
        self._moving = 0
        self._sharp: list[float] = []
        self._rested = 0.0
        self._steps = QTimer(self, interval=15)
        self._steps.timeout.connect(self._fly)

    def start(self) -> None:
        """To be called before the event loop runs."""
        self._figures["start_s"] = None
        QTimer.singleShot(0, self._on_usable)

    def _on_usable(self) -> None:
        born = psutil.Process().create_time()
        self._figures["start_s"] = round(time.time() - born, 3)
        # Reading the project and starting the drawing process must not be felt either.
        self._probe.start()
        self._begin = time.perf_counter()
        self._wait()

    def _wait(self) -> None:
        contents = self._session.document.contents
        if self._scene.picture is not None:
            self._scene.pictureShown.connect(self._on_shown)
            self._home = self._scene.pose
            self._begin = time.perf_counter()
            self._steps.start()
        elif time.perf_counter() - self._begin > (PATIENCE if contents.scene_stamp is not None else 5.0):
            self._finish()
        else:
            QTimer.singleShot(50, self._wait)

    def _fly(self) -> None:
        seconds = time.perf_counter() - self._begin
        if seconds < FLIGHT:
            pose = cameras.turned(self._home, tau * seconds / FLIGHT, 0.15 * sin(seconds))
            self._scene.navigation.set_pose(cameras.flown(pose, 0.5 * sin(seconds), 0.0, 0.0))
            return
        self._steps.stop()
        self._figures["fps_moving"] = round(self._moving / seconds, 1)
        self._rested = time.perf_counter()

    def _on_shown(self, picture: Picture) -> None:
        if self._steps.isActive():
            self._moving += picture.request.moving
            return
        if picture.request.moving or not self._rested:
            return
        self._sharp.append(1e3 * (time.perf_counter() - self._rested))
        if len(self._sharp) < RESTS:
            self._rested = 0.0
            QTimer.singleShot(100, self._nudge)
        else:
            self._finish()

    def _nudge(self) -> None:
        self._scene.navigation.set_pose(cameras.turned(self._scene.pose, 0.05, 0.0))
        self._rested = time.perf_counter()

    def _finish(self) -> None:
        self._probe.stop()
        me = psutil.Process()
        rss = sum(p.memory_info().rss for p in [me, *me.children(recursive=True)])
        self._figures |= {
            "gap_p99_ms": round(self._probe.quantile(0.99), 1),
            "gap_max_ms": round(self._probe.longest, 1),
            "sharp_ms": round(sorted(self._sharp)[len(self._sharp) // 2], 1) if self._sharp else None,
            "rss_mb": round(rss / 2**20),
            "renderer": None if self._scene.picture is None else self._scene.picture.renderer,
        }
        self._figures.setdefault("fps_moving", None)
        self.finished.emit(self._figures)
