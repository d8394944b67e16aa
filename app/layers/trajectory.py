"""The trajectory on the floor in the colors of its submaps. While the camera poses of a video are computed, the cameras
so far in the colors of the pieces of the video."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QColor, QPainter, QPen

from app.layers.layer import Layer
from app.look import colors
from app.painting.picking import NEAR, projected_segments
from app.painting.primitives import Primitives, disc
from app.state.document import Document
from app.state.on_floor import trajectory_on_floor
from app.state.weak_spots import weak_spots
from nvsim.geometry.camera import Camera
from nvsim.project.work import STAGE


class TrajectoryLayer(Layer):
    """The trajectory, with marks at weak camera poses of a reconstruction."""

    name = "trajectory"
    title = "Trajectory"

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._weak = disc(colors.WARNING, "#3a2c05", 14)

    @property
    def missing(self) -> str:
        return "" if len(self._document.drawn_trajectory.positions) else STAGE["import"].lacking

    def paint(self, painter: QPainter, camera: Camera) -> None:
        trajectory = self._document.drawn_trajectory
        pairs = trajectory.segments
        if len(pairs) == 0:
            return
        is_growing = trajectory is self._document.contents.growing
        positions = trajectory.positions if is_growing else trajectory_on_floor(self._document)
        lines, index, _ = projected_segments(camera, positions[pairs[:, 0]], positions[pairs[:, 1]])
        owners = trajectory.submaps[pairs[index, 1]]
        for owner in np.unique(owners):
            color = QColor(colors.submap_color(int(owner)))
            color.setAlpha(220)
            painter.setPen(QPen(color, 2.0))
            self._primitives.draw_lines(painter, lines[owners == owner])
        spots, _ = weak_spots(self._document)
        if len(spots):
            pixels, depths = camera.project(positions[spots])
            self._primitives.draw_sprites(painter, pixels[depths > NEAR], np.ones((1, 2)), self._weak)
