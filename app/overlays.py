"""What is drawn over the reconstruction: graph, trajectory, ground grid, labels. Renders from the document, owns
nothing of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPen

from app import colors
from app.document import Document
from app.picking import NEAR, nearest_point, projected_segments
from app.primitives import Primitives, chip, disc
from nvsim.geometry.camera import Camera

LABEL_DISTANCE = 6.0  # metres
MOST_LABELS = 24
PICK_TOLERANCE = 10.0  # pixels
# Beyond this many lines their smooth edges cost more than they give.
SMOOTH_LINES = 4000
_NODE_METRES = 0.16  # radius of a viewpoint's disc on the floor
_NODE_PIXELS = (3.5, 42.0)  # least and most radius of a disc


@dataclass
class Layers:
    """Which overlays are shown."""

    graph: bool = True
    trajectory: bool = True
    labels: bool = True
    grid: bool = False


class Overlays:
    """Draws over a picture that `camera` took, scaled to the widget's logical pixels."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self.layers = Layers()
        self.hovered: str | None = None
        self._primitives = Primitives()
        self._node = disc(colors.NODE, colors.NODE_OUTLINE)
        self._left_out = disc(colors.TRAJECTORY, "#20252b")
        self._selected = disc(colors.SELECTED, "#3a2c05", 36)
        self._frame = disc(colors.CAMERA, "#3d1010", 20)

    def paint(self, painter: QPainter, camera: Camera) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self.layers.grid:
            self._paint_grid(painter, camera)
        if self.layers.trajectory:
            self._paint_trajectory(painter, camera)
        if self.layers.graph:
            self._paint_graph(painter, camera)
        self._paint_selected_frame(painter, camera)

    def pick_viewpoint(self, camera: Camera, cursor: QPointF) -> str | None:
        """The id of the viewpoint under the cursor."""
        arrays = self._document.graph_arrays
        if not self.layers.graph or not arrays.ids:
            return None
        row = nearest_point(*camera.project(arrays.feet), (cursor.x(), cursor.y()), PICK_TOLERANCE)
        return None if row is None else arrays.ids[row]

    def pick_frame(self, camera: Camera, cursor: QPointF) -> int | None:
        """The index of the frame whose position is under the cursor."""
        if not self.layers.trajectory or len(self._document.trajectory.positions) == 0:
            return None
        positions = self.walk()
        return nearest_point(*camera.project(positions), (cursor.x(), cursor.y()), PICK_TOLERANCE)

    def walk(self) -> NDArray[np.float64]:
        """The trajectory as it is drawn: on the floor like the graph, because from a camera at the same height it would
        be one line along the horizon."""
        arrays = self._document.graph_arrays
        lowered = self._document.trajectory.positions.copy()
        if arrays.ids:
            lowered[:, 2] -= float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2]))
        return lowered

    def _paint_grid(self, painter: QPainter, camera: Camera) -> None:
        extent = self._document.extent
        if len(extent) == 0:
            return
        low, high = np.floor(extent.min(axis=0) - 2), np.ceil(extent.max(axis=0) + 2)
        height = float(np.median(extent[:, 2])) - 1.5
        x, y = np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1)
        a = np.concatenate([[(v, low[1], height) for v in x], [(low[0], v, height) for v in y]])
        b = np.concatenate([[(v, high[1], height) for v in x], [(high[0], v, height) for v in y]])
        lines, _, _ = projected_segments(camera, a, b)
        painter.setPen(QPen(QColor(150, 165, 180, 46), 1))
        self._primitives.draw_lines(painter, lines)

    def _paint_trajectory(self, painter: QPainter, camera: Camera) -> None:
        trajectory = self._document.trajectory
        pairs = trajectory.segments
        if len(pairs) == 0:
            return
        positions = self.walk()
        lines, index, _ = projected_segments(camera, positions[pairs[:, 0]], positions[pairs[:, 1]])
        owners = trajectory.submaps[pairs[index, 1]]
        for owner in np.unique(owners):
            color = QColor(colors.submap_color(int(owner)))
            color.setAlpha(220)
            painter.setPen(QPen(color, 2.0))
            self._primitives.draw_lines(painter, lines[owners == owner])

    def _paint_graph(self, painter: QPainter, camera: Camera) -> None:
        arrays = self._document.graph_arrays
        if not arrays.ids:
            return
        ends = arrays.feet[arrays.edges]
        lines, _, depth = projected_segments(camera, ends[:, 0], ends[:, 1])
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < SMOOTH_LINES)
        for near, far, width, opacity in ((12.0, np.inf, 1.2, 170), (5.0, 12.0, 1.8, 190), (0.0, 5.0, 2.6, 225)):
            color = QColor(colors.EDGE)
            color.setAlpha(opacity)
            painter.setPen(QPen(color, width))
            self._primitives.draw_lines(painter, lines[(depth >= near) & (depth < far)])
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)

        pixels, depths = camera.project(arrays.feet)
        k = camera.intrinsics
        margin = 20
        seen = (depths > NEAR) & (pixels > -margin).all(axis=1)
        seen &= (pixels[:, 0] < k.width + margin) & (pixels[:, 1] < k.height + margin)
        radius = np.clip(_NODE_METRES * k.fy / np.maximum(depths, NEAR), *_NODE_PIXELS)
        # A disc that lies on the floor looks flatter the more level the view of it is.
        toward = arrays.feet - camera.position
        flat = np.abs(toward[:, 2]) / np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
        shape = np.stack([radius, np.maximum(radius * np.maximum(flat, 0.3), 2.5)], axis=1)
        order = np.flatnonzero(seen)
        order = order[np.argsort(-depths[order])]  # far ones first
        for sprite, among in ((self._left_out, ~arrays.included), (self._node, arrays.included)):
            rows = order[among[order]]
            self._primitives.draw_sprites(painter, pixels[rows], shape[rows] / 12, sprite)
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self.hovered or "")
        for row, scale in ((hovered, 1.25), (selected, 1.0)):
            if row is not None and seen[row]:
                sprite = self._selected if row == selected else self._node
                size = np.maximum(shape[[row]], 4.0) * scale * 1.35 / (sprite.width() / 4)
                self._primitives.draw_sprites(painter, pixels[[row]], size, sprite)
        if selected is not None:
            self._paint_stem(painter, camera, arrays.feet[selected], arrays.positions[selected])
        if self.layers.labels:
            near = order[depths[order] < LABEL_DISTANCE][-MOST_LABELS:].tolist()
            rows = dict.fromkeys([*near, *(r for r in (selected, hovered) if r is not None and seen[r])])
            self._paint_labels(painter, list(rows), pixels, radius, selected)

    def _paint_stem(self, painter: QPainter, camera: Camera, foot: np.ndarray, eye: np.ndarray) -> None:
        lines, _, _ = projected_segments(camera, foot[None], eye[None])
        painter.setPen(QPen(QColor(colors.SELECTED), 1.6))
        self._primitives.draw_lines(painter, lines)
        pixel, depth = camera.project(eye[None])
        if depth[0] > NEAR:
            self._primitives.draw_sprites(painter, pixel, np.full((1, 2), 0.2), self._selected)

    def _paint_labels(
        self, painter: QPainter, rows: list[int], pixels: np.ndarray, radius: np.ndarray, selected: int | None
    ) -> None:
        font = QFont(painter.font())
        font.setPointSizeF(8)
        painter.setFont(font)
        ids = self._document.graph_arrays.ids
        for row in rows:
            anchor = QPointF(pixels[row, 0] + radius[row] + 4, pixels[row, 1] + 8)
            fill = QColor(58, 44, 5, 220) if row == selected else QColor(16, 20, 26, 170)
            chip(painter, anchor, short_id(ids[row]), QColor(colors.SELECTED if row == selected else "#dfe7ee"), fill)

    def _paint_selected_frame(self, painter: QPainter, camera: Camera) -> None:
        index, capture = self._document.selection.frame, self._document.contents.capture
        if index is None or capture is None:
            return
        frame = capture.frames[index]
        if np.linalg.norm(frame.camera_to_world[:3, 3] - camera.position) < 0.3:
            return  # the eye is in the frame's own camera; its frustum would only line the picture
        k, size = frame.intrinsics, 0.35
        corners = np.array([(0, 0), (k.width, 0), (k.width, k.height), (0, k.height)], float)
        rays = np.stack([(corners[:, 0] - k.cx) / k.fx, (corners[:, 1] - k.cy) / k.fy, np.ones(4)], axis=1) * size
        pose = frame.camera_to_world
        tips = rays @ pose[:3, :3].T + pose[:3, 3]
        eye = np.repeat(pose[None, :3, 3], 4, axis=0)
        lines, _, _ = projected_segments(
            camera, np.concatenate([eye, tips]), np.concatenate([tips, np.roll(tips, -1, axis=0)])
        )
        pen = QPen(QColor(colors.CAMERA), 2)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        painter.setPen(pen)
        self._primitives.draw_lines(painter, lines)
        pixels, depth = camera.project(eye[:1])
        if depth[0] > NEAR:
            self._primitives.draw_sprites(painter, pixels, np.full((1, 2), 0.5), self._frame)


def short_id(id: str) -> str:
    """Enough of a viewpoint id to tell it from its neighbours."""
    return id if len(id) <= 10 else id[:6]
