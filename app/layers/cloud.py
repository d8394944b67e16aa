"""The thinned point cloud of the capture as dots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPainter

from app.layers.layer import Layer
from app.painting.dots import MOST, Dots
from app.state.document import Document
from nvsim.geometry.camera import Camera

MOST_MOVING = 12_000
_NEAR = 0.1  # meters
_LARGE = 3.0  # meters; nearer points get a dot of 3 pixels instead of 2


class CloudLayer(Layer):
    """The point cloud, written directly into an image; one painter call per dot would take ten times as long."""

    name = "cloud"
    title = "Point cloud"
    shown = False
    opacity = 0.8

    def __init__(self, document: Document) -> None:
        self._document = document
        self._dots: Dots | None = None
        self._image = np.zeros((0, 0), np.uint32)

    @property
    def missing(self) -> str:
        return "" if self._document.contents.scan_cloud is not None else "there is no point cloud"

    def forget(self) -> None:
        self._dots = None

    def paint(self, painter: QPainter, camera: Camera) -> None:
        cloud = self._document.contents.scan_cloud
        if cloud is None:
            self._dots = None
            return
        if self._dots is None or self._dots.cloud is not cloud:
            ready = self._document.contents.dots
            self._dots = ready if ready is not None and ready.cloud is cloud else Dots.of(cloud)
        k = camera.intrinsics
        if self._image.shape != (k.height, k.width):
            self._image = np.zeros((k.height, k.width), np.uint32)
        self._image[:] = 0
        most = MOST_MOVING if self.moving else MOST
        draw_dots(self._image, camera, self._dots.points[:most], self._dots.tones[:most])
        picture = QImage(self._image.data, k.width, k.height, 4 * k.width, QImage.Format.Format_ARGB32_Premultiplied)
        painter.drawImage(QRectF(0, 0, k.width, k.height), picture)


def draw_dots(
    image: NDArray[np.uint32], camera: Camera, points: NDArray[np.float32], tones: NDArray[np.uint32]
) -> None:
    """Writes a dot of 2 or 3 pixels for each of `points` (N, 3) in meters, world, with colors `tones` (N,) into `image`
    (H, W). Near dots cover far dots."""
    height, width = image.shape
    to_camera = camera.world_to_camera.astype(np.float32)
    x, y, depths = to_camera[:3, :3] @ points.T + to_camera[:3, 3:]
    k = camera.intrinsics
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = np.float32(k.fx) * x / depths + np.float32(k.cx), np.float32(k.fy) * y / depths + np.float32(k.cy)
    seen = (depths > _NEAR) & (x >= 0) & (y >= 0) & (x < width - 2) & (y < height - 2)
    rows = np.flatnonzero(seen)
    # Whole centimeters up to 655 m, because sorting 16-bit integers takes a tenth of the time of floats.
    nearness = np.uint16(65535) - np.minimum(100 * depths[rows], 65535).astype(np.uint16)
    rows = rows[np.argsort(nearness, kind="stable")]
    places, tones, depths = y[rows].astype(np.intp) * width + x[rows].astype(np.intp), tones[rows], depths[rows]
    flat = image.reshape(-1)
    first_near = int(np.searchsorted(-depths, -_LARGE))
    for part, size in ((slice(None, first_near), 2), (slice(first_near, None), 3)):
        for offset in (dy * width + dx for dy in range(size) for dx in range(size)):
            flat[places[part] + offset] = tones[part]
