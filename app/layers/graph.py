"""The navigation graph on the floor: edges, discs for viewpoints, and a stem to the eye of the selected one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor, QPainter, QPen

from app import colors
from app.document import Document
from app.graph_arrays import GraphArrays
from app.layers.layer import Layer
from app.picking import NEAR, projected_segments
from app.primitives import Primitives, disc
from nvsim.geometry.camera import Camera

# Beyond this many lines their smooth edges cost more than they give.
SMOOTH_LINES = 4000
_NODE_METRES = 0.16  # radius of a viewpoint's disc on the floor
_NODE_PIXELS = (3.5, 42.0)  # least and most radius of a disc
_MARGIN = 20  # pixels beside the picture whose discs still reach into it


@dataclass(frozen=True, eq=False)
class Seen:
    """The viewpoints as one camera sees them; arrays have a row for each viewpoint.

    pixels (N, 2), depths (N,) in metres, seen (N,), radius (N,) in pixels; order (K,) those seen, far ones first
    """

    camera: Camera
    arrays: GraphArrays
    pixels: NDArray[np.float64]
    depths: NDArray[np.float64]
    seen: NDArray[np.bool_]
    radius: NDArray[np.float64]
    order: NDArray[np.int64]

    @staticmethod
    def of(camera: Camera, arrays: GraphArrays) -> Seen:
        pixels, depths = camera.project(arrays.feet)
        k = camera.intrinsics
        seen = (depths > NEAR) & (pixels > -_MARGIN).all(axis=1)
        seen &= (pixels[:, 0] < k.width + _MARGIN) & (pixels[:, 1] < k.height + _MARGIN)
        radius = np.clip(_NODE_METRES * k.fy / np.maximum(depths, NEAR), *_NODE_PIXELS)
        order = np.flatnonzero(seen)
        return Seen(camera, arrays, pixels, depths, seen, radius, order[np.argsort(-depths[order])])


class GraphLayer(Layer):
    """`hovered` is set by the views: the id under the cursor."""

    name = "graph"
    title = "Graph"

    def __init__(self, document: Document) -> None:
        self._document = document
        self.hovered: str | None = None
        self._primitives = Primitives()
        self._node = disc(colors.NODE, colors.NODE_OUTLINE)
        self._left_out = disc(colors.TRAJECTORY, "#20252b")
        self._selected = disc(colors.SELECTED, "#3a2c05", 36)
        self._latest: Seen | None = None

    @property
    def missing(self) -> str:
        return "" if self._document.graph_arrays.ids else "no navigation graph is built yet"

    def seen(self, camera: Camera) -> Seen:
        """Where the viewpoints are for `camera`; kept for the next who asks with the same."""
        arrays = self._document.graph_arrays
        if self._latest is None or self._latest.camera is not camera or self._latest.arrays is not arrays:
            self._latest = Seen.of(camera, arrays)
        return self._latest

    def paint(self, painter: QPainter, camera: Camera) -> None:
        arrays = self._document.graph_arrays
        if arrays.ids:
            self._paint_edges(painter, camera, arrays)
            self._paint_viewpoints(painter, self.seen(camera))

    def _paint_edges(self, painter: QPainter, camera: Camera, arrays: GraphArrays) -> None:
        ends = arrays.feet[arrays.edges]
        lines, _, depth = projected_segments(camera, ends[:, 0], ends[:, 1])
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < SMOOTH_LINES)
        for near, far, width, opacity in ((12.0, np.inf, 1.2, 170), (5.0, 12.0, 1.8, 190), (0.0, 5.0, 2.6, 225)):
            color = QColor(colors.EDGE)
            color.setAlpha(opacity)
            painter.setPen(QPen(color, width))
            self._primitives.draw_lines(painter, lines[(depth >= near) & (depth < far)])
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)

    def _paint_viewpoints(self, painter: QPainter, view: Seen) -> None:
        arrays, radius = view.arrays, view.radius
        # A disc that lies on the floor looks flatter the more level the view of it is.
        toward = arrays.feet - view.camera.position
        flat = np.abs(toward[:, 2]) / np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
        shape = np.stack([radius, np.maximum(radius * np.maximum(flat, 0.3), 2.5)], axis=1)
        for sprite, among in ((self._left_out, ~arrays.included), (self._node, arrays.included)):
            rows = view.order[among[view.order]]
            self._primitives.draw_sprites(painter, view.pixels[rows], shape[rows] / 12, sprite)
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self.hovered or "")
        for row, scale in ((hovered, 1.25), (selected, 1.0)):
            if row is not None and view.seen[row]:
                sprite = self._selected if row == selected else self._node
                size = np.maximum(shape[[row]], 4.0) * scale * 1.35 / (sprite.width() / 4)
                self._primitives.draw_sprites(painter, view.pixels[[row]], size, sprite)
        if selected is not None:
            self._paint_stem(painter, view.camera, arrays.feet[selected], arrays.positions[selected])

    def _paint_stem(self, painter: QPainter, camera: Camera, foot: np.ndarray, eye: np.ndarray) -> None:
        lines, _, _ = projected_segments(camera, foot[None], eye[None])
        painter.setPen(QPen(QColor(colors.SELECTED), 1.6))
        self._primitives.draw_lines(painter, lines)
        pixel, depth = camera.project(eye[None])
        if depth[0] > NEAR:
            self._primitives.draw_sprites(painter, pixel, np.full((1, 2), 0.2), self._selected)
