"""The regions of interest of the selected viewpoint in the 3D view and on the map."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPainterPath, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsPathItem

from nvsim.geometry.camera import Camera
from nvsim_app.inspector.state import Inspection
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.painting.picking import NEAR
from nvsim_app.state.directions import Direction

_POINTED = 60  # alpha of the fill of the highlighted region, 0 to 255; the others are outlines


def clip_at_near_plane(corners: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """The polygon (N, 3) in meters, world, clipped at the near plane of `camera`: (M, 3), with fewer than three points
    if it is not visible."""
    depth = (corners - camera.position) @ camera.rotation[:, 2] - NEAR
    kept = []
    for i in range(len(corners)):
        a, b, da, db = corners[i - 1], corners[i], depth[i - 1], depth[i]
        if (da > 0) != (db > 0):
            kept.append(a + da / (da - db) * (b - a))
        if db > 0:
            kept.append(b)
    return np.array(kept).reshape(-1, 3)


class RegionLayer(Layer):
    """The regions as a layer of the 3D view. If `suppressed` is set, the layer is hidden even if the user enabled
    it."""

    name = "rois"
    title = "Regions of interest"
    opacity = 0.85
    suppressed = False

    def __init__(self, inspection: Inspection) -> None:
        self._inspection = inspection

    @property
    def missing(self) -> str:
        """Why there is nothing to draw, as text; "" if there is something."""
        return "" if self._inspection.directions else "no viewpoint with evidence is selected"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """Draws over the image of `camera`, whose intrinsics use logical pixels of the widget."""
        if self.suppressed:
            return
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        current = self._inspection.current
        for direction in sorted(self._inspection.directions, key=lambda d: d is current):
            pointed = direction is current
            if not direction.lattice and not pointed:
                continue  # corridors of edges would cover the regions of the steps
            ink = QColor(colors.OPEN if direction.open else colors.BLOCKED)
            fill = QColor(ink)
            fill.setAlpha(_POINTED if pointed else 0)  # filled regions would cover the floor
            style = Qt.PenStyle.SolidLine if direction.open else Qt.PenStyle.DotLine
            pen = QPen(QColor(colors.SELECTED) if pointed else ink, 2.4 if pointed else 1.4, style)
            _draw(painter, camera, direction.polygon(), pen, fill)
            failed = direction.failed_corners()
            if failed is not None:
                strong = QColor(colors.BLOCKED)
                strong.setAlpha(235 if pointed else 170)
                _draw(painter, camera, failed, QPen(QColor("#ffffff") if pointed else strong, 1.0), strong)


def _draw(painter: QPainter, camera: Camera, corners: NDArray[np.float64], pen: QPen, fill: QColor) -> None:
    seen = clip_at_near_plane(corners, camera)
    if len(seen) < 3:
        return
    pixels, _ = camera.project(seen)
    k = camera.intrinsics
    if (pixels.max(axis=0) < 0).any() or pixels[:, 0].min() > k.width or pixels[:, 1].min() > k.height:
        return
    painter.setPen(pen)
    painter.setBrush(fill)
    painter.drawPolygon(QPolygonF([QPointF(x, y) for x, y in np.clip(pixels, -1e5, 1e5)]))


class RegionMarks(QObject):
    """The regions on the map, with the highlighted one on top."""

    def __init__(self, plot: pg.PlotWidget, inspection: Inspection, parent: QObject) -> None:
        super().__init__(parent)
        self._inspection = inspection
        self._items = {key: QGraphicsPathItem() for key in ("open", "blocked", "pointed")}
        for z, (key, item) in enumerate(self._items.items()):
            ink = QColor({"open": colors.OPEN, "blocked": colors.BLOCKED, "pointed": colors.SELECTED}[key])
            style = Qt.PenStyle.DotLine if key == "blocked" else Qt.PenStyle.SolidLine
            pen = QPen(ink, 2.2 if key == "pointed" else 1.0, style)
            pen.setCosmetic(True)
            item.setPen(pen)
            fill = QColor(ink)
            fill.setAlpha(_POINTED if key == "pointed" else 0)
            item.setBrush(fill)
            item.setZValue(24 + z)
            item.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
            # The regions must not change the automatic range of the map.
            plot.addItem(item, ignoreBounds=True)
        inspection.changed.connect(self.refresh)
        inspection.pointed.connect(self.refresh)
        self.refresh()

    def set_shown(self, on: bool) -> None:
        for item in self._items.values():
            item.setVisible(on)

    def refresh(self) -> None:
        current = self._inspection.current
        lattice = [d for d in self._inspection.directions if d.lattice]
        self._items["open"].setPath(_path([d for d in lattice if d.open]))
        self._items["blocked"].setPath(_path([d for d in lattice if not d.open]))
        self._items["pointed"].setPath(_path([] if current is None else [current]))


def _path(found: list[Direction]) -> QPainterPath:
    path = QPainterPath()
    for direction in found:
        path.addPolygon(QPolygonF([QPointF(x, y) for x, y in direction.polygon()[:, :2]]))
        path.closeSubpath()
    return path
