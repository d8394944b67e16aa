"""The point cloud of the capture, thinned, as dots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPainter

from app.document import Document
from app.layers.layer import Layer
from app.tones import ramp
from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera

MOST = 60_000  # points drawn; evenly taken from all
_NEAR = 0.1  # metres
_LARGE = 3.0  # metres; nearer points get a dot of 3 pixels instead of 2
_TURN = np.uint32(2654435761)


class CloudLayer(Layer):
    """Written straight into a picture: a painter call for each dot would take ten times as long."""

    name = "cloud"
    title = "Point cloud"
    shown = False
    opacity = 0.8

    def __init__(self, document: Document) -> None:
        self._document = document
        self._of: object = None
        self._points = np.zeros((0, 3), np.float32)
        self._tones = np.zeros(0, np.uint32)
        self._image = np.zeros((0, 0), np.uint32)

    @property
    def missing(self) -> str:
        capture = self._document.contents.capture
        return "" if capture is not None and capture.cloud is not None else "the capture has no point cloud"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        capture = self._document.contents.capture
        if capture is None or capture.cloud is None:
            return
        if self._of is not capture.cloud:
            self._points, self._tones = thinned(capture.cloud)
            self._of = capture.cloud
        k = camera.intrinsics
        if self._image.shape != (k.height, k.width):
            self._image = np.zeros((k.height, k.width), np.uint32)
        self._image[:] = 0
        draw_dots(self._image, camera, self._points, self._tones)
        picture = QImage(self._image.data, k.width, k.height, 4 * k.width, QImage.Format.Format_ARGB32_Premultiplied)
        painter.drawImage(QRectF(0, 0, k.width, k.height), picture)


def thinned(cloud: Cloud) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """At most MOST points (N, 3) and their tones (N,) 0xffRRGGBB; without colours the height makes them."""
    count = len(cloud.points)
    rows = np.arange(count)
    if count > MOST:
        # A walk through the file in steps would take whole scan lines; a scattered order takes some of each.
        rows = np.argsort((rows.astype(np.uint32) * _TURN), kind="stable")[:MOST]
    points = cloud.points[rows]
    if cloud.colors is not None:
        rgb = cloud.colors[rows].astype(np.uint32)
    else:
        low, high = np.quantile(points[:, 2], (0.02, 0.98)) if len(points) else (0.0, 1.0)
        rgb = ramp((points[:, 2] - low) / max(high - low, 1e-3)).astype(np.uint32)
    return points, (0xFF << 24 | rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2]).astype(np.uint32)


def draw_dots(
    image: NDArray[np.uint32], camera: Camera, points: NDArray[np.float32], tones: NDArray[np.uint32]
) -> None:
    """Writes a dot of 2 or 3 pixels for each of `points` (N, 3) into `image` (H, W); near ones over far ones."""
    height, width = image.shape
    pixels, depths = camera.project(points)
    seen = (depths > _NEAR) & (pixels >= 0).all(axis=1) & (pixels[:, 0] < width - 2) & (pixels[:, 1] < height - 2)
    rows = np.flatnonzero(seen)
    rows = rows[np.argsort(-depths[rows])]
    for among, size in ((rows[depths[rows] >= _LARGE], 2), (rows[depths[rows] < _LARGE], 3)):
        at = pixels[among].astype(np.intp)
        for dy in range(size):
            for dx in range(size):
                image[at[:, 1] + dy, at[:, 0] + dx] = tones[among]
