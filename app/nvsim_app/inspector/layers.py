"""The regions of interest of the selected viewpoint in the 3D view and on the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF

from nvsim.geometry.camera import Camera
from nvsim_app.inspector.state import Inspection
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.painting.picking import NEAR
from nvsim_app.state.directions import Direction
from nvsim_app.views.graph_surface import GraphSurface, MapSurface

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
    """The regions as a layer of the 3D view, and on the map. If `suppressed` is set, they are hidden even if the user
    enabled the layer."""

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
        for direction, pointed in self._drawn():
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

    def paint_on_map(self, painter: QPainter, surface: GraphSurface) -> None:
        if self.suppressed or not isinstance(surface, MapSurface):
            return
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for direction, pointed in self._drawn():
            ink = QColor(colors.SELECTED if pointed else colors.OPEN if direction.open else colors.BLOCKED)
            style = Qt.PenStyle.SolidLine if pointed or direction.open else Qt.PenStyle.DotLine
            fill = QColor(ink)
            fill.setAlpha(_POINTED if pointed else 0)
            _draw_polygon(
                painter, surface.project(direction.polygon())[0], QPen(ink, 2.2 if pointed else 1.0, style), fill
            )
        painter.restore()

    def _drawn(self) -> list[tuple[Direction, bool]]:
        """The drawn directions, and whether each is highlighted; the highlighted one is last. Corridors of edges are
        not drawn otherwise, because they would cover the regions of the steps."""
        current = self._inspection.current
        drawn = [(d, d is current) for d in self._inspection.directions if d.lattice or d is current]
        return sorted(drawn, key=lambda each: each[1])


def _draw(painter: QPainter, camera: Camera, corners: NDArray[np.float64], pen: QPen, fill: QColor) -> None:
    seen = clip_at_near_plane(corners, camera)
    if len(seen) < 3:
        return
    pixels, _ = camera.project(seen)
    k = camera.intrinsics
    if (pixels.max(axis=0) < 0).any() or pixels[:, 0].min() > k.width or pixels[:, 1].min() > k.height:
        return
    _draw_polygon(painter, pixels, pen, fill)


def _draw_polygon(painter: QPainter, pixels: NDArray[np.float64], pen: QPen, fill: QColor) -> None:
    painter.setPen(pen)
    painter.setBrush(fill)
    painter.drawPolygon(QPolygonF([QPointF(x, y) for x, y in np.clip(pixels, -1e5, 1e5)]))
