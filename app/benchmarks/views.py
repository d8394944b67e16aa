"""The frame rates of the 3D view and the map while a graph is panned, zoomed, and hovered over."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from PySide6.QtCore import QCoreApplication, QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QWidget

from app.painting import cameras
from app.wiring.panels import MapPart
from app.wiring.window import MainWindow

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
    scene.show_source(None)
    scene.navigation.set_pose(cameras.overview(document.extent))
    plan.frame_everything()
    yield 0.3

    def pan_scene(step: int) -> None:
        scene.navigation.set_pose(cameras.turned(scene.pose, 0.01 if step % 60 < 30 else -0.01, 0.0))
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
