"""The layers on the floor: the occupancy map, and a grid while there is no reconstruction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QImage, QPainter, QPen

from nvsim.geometry.camera import Camera
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap
from nvsim_app.layers.layer import Layer
from nvsim_app.painting.graph_ink import DrawingCache
from nvsim_app.painting.picking import projected_segments
from nvsim_app.painting.primitives import Primitives
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import floor_height
from nvsim_app.state.graph_arrays import column_bounds

_SMOOTH = 120  # lines


class GridLayer(Layer):
    """The ground grid. The view sets `bare`, whether it shows no image of a reconstruction."""

    name = "grid"
    title = "Ground grid"

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._kept = DrawingCache()
        self.bare = False

    @property
    def missing(self) -> str:
        return "" if self.bare else "shown only without a reconstruction"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        extent = self._document.extent
        if not self.bare or len(extent) == 0:
            return
        low, high = column_bounds(extent)
        low, high = np.floor(low - 2), np.ceil(high + 2)
        height = round(float(np.median(extent[:, 2])), 1) - 1.5  # an edit of one viewpoint does not change it
        k = camera.intrinsics
        key = (camera, *low[:2].tolist(), *high[:2].tolist(), height)
        self._kept.paint(painter, k.width, k.height, key, lambda p, _: self._paint_all(p, camera, low, high, height))

    def _paint_all(
        self, painter: QPainter, camera: Camera, low: NDArray[np.float64], high: NDArray[np.float64], height: float
    ) -> None:
        step = max(1.0, np.ceil(float(max(high[:2] - low[:2])) / 200))  # large sites get a wider spacing
        x, y = np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step)
        a = np.concatenate([[(v, low[1], height) for v in x], [(low[0], v, height) for v in y]])
        b = np.concatenate([[(v, high[1], height) for v in x], [(high[0], v, height) for v in y]])
        lines, _, _ = projected_segments(camera, a, b)
        painter.setPen(QPen(QColor(150, 165, 180, 46), 1))
        # On a large site, antialiasing of the grid would take longer than painting all viewpoints.
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < _SMOOTH)
        self._primitives.draw_lines(painter, lines)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)


_RAYS = 60_000  # maximum number of rays; a smaller image is enlarged to the view
_RAYS_MOVING = 15_000
_FAR = 60.0  # meters
_FREE, _OCCUPIED = (0x40, 0x3F, 0xB3, 0x7F), (0xC0, 0xE0, 0x5D, 0x5D)  # alpha, red, green, blue


class OccupancyLayer(Layer):
    """Paints free floor in green and obstacles in red. It intersects one ray per few pixels with the floor below the
    camera, which is faster than painting cells and correct at the horizon."""

    name = "occupancy"
    title = "Occupancy on the floor"
    shown = False
    opacity = 0.7

    def __init__(self, document: Document) -> None:
        self._document = document
        self._of: object = None
        self._tones = np.zeros((0, 0), np.uint32)
        self._key: object = None  # key of the last image, which stays valid after edits of the graph
        self._image = np.zeros((1, 1), np.uint32)

    @property
    def missing(self) -> str:
        return "" if self._document.contents.occupancy is not None else "the project has no occupancy map yet"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        occupancy = self._document.contents.occupancy
        if occupancy is None:
            return
        k, (x, y, z) = camera.intrinsics, camera.position
        floor = floor_height(self._document, float(x), float(y), below=float(z))
        rays = _RAYS_MOVING if self.moving else _RAYS
        key = (camera, occupancy, round(floor, 2), rays)
        if key != self._key:
            self._key, self._image = key, self._pixel_colors(camera, occupancy, floor, rays)
        height, width = self._image.shape
        picture = QImage(self._image.data, width, height, 4 * width, QImage.Format.Format_ARGB32_Premultiplied)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(QRectF(0, 0, k.width, k.height), picture)

    def _pixel_colors(self, camera: Camera, occupancy: OccupancyMap, floor: float, rays: int) -> NDArray[np.uint32]:
        """(H, W) premultiplied colors, one per ray."""
        if self._of is not occupancy:
            self._tones = np.zeros(occupancy.cells.shape, np.uint32)
            self._tones[occupancy.cells == FREE] = _premultiplied(*_FREE)
            self._tones[occupancy.cells == OCCUPIED] = _premultiplied(*_OCCUPIED)
            self._of = occupancy
        k = camera.intrinsics
        share = min(1.0, (rays / (k.width * k.height)) ** 0.5)
        width, height = max(1, round(k.width * share)), max(1, round(k.height * share))
        places = floor_places(camera.scaled(width, height), floor)
        cells = np.floor((places - occupancy.origin) / occupancy.resolution)
        rows, columns = self._tones.shape
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=-1)  # False for NaN
        image = np.zeros((height, width), np.uint32)
        image[inside] = self._tones[cells[inside][:, 1].astype(np.intp), cells[inside][:, 0].astype(np.intp)]
        return image


def floor_places(camera: Camera, floor: float) -> NDArray[np.float32]:
    """(H, W, 2) world x, y in meters of the intersection of each pixel's ray with z = `floor` (meters). NaN if the
    depth of the intersection is not between 0 and 60 m."""
    k = camera.intrinsics
    right, down, forward = camera.rotation.astype(np.float32).T
    u = ((np.arange(k.width, dtype=np.float32) + 0.5 - k.cx) / k.fx)[None, :, None]
    v = ((np.arange(k.height, dtype=np.float32) + 0.5 - k.cy) / k.fy)[:, None, None]
    rays = u * right + v * down + forward
    drop = np.float32(floor - camera.position[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        way = drop / rays[..., 2]
        way[~((way > 0) & (way < _FAR))] = np.nan
    return np.asarray(camera.position[:2].astype(np.float32) + way[..., None] * rays[..., :2], np.float32)


def _premultiplied(alpha: int, red: int, green: int, blue: int) -> int:
    r, g, b = (value * alpha // 255 for value in (red, green, blue))
    return alpha << 24 | r << 16 | g << 8 | b
