"""The floor mask of a frame in the 3D view, shown while the camera is at the frame's position, in any direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QImage, QPainter, QTransform

from app.layers.layer import Layer
from nvsim.geometry.camera import Camera

STANDING_IN = 0.02  # meters; from farther away, the mask would not match the floor


class FrameMaskLayer(Layer):
    """The floor mask of the frame that `show` sets."""

    name = "frame_mask"
    title = "Floor mask of the frame"
    shown = False
    opacity = 0.45

    def __init__(self) -> None:
        self._camera: Camera | None = None
        self._image: QImage | None = None

    @property
    def missing(self) -> str:
        return "" if self._image is not None else "no frame with a floor mask is selected"

    def show(self, camera: Camera | None, image: QImage | None) -> None:
        """Sets the camera of a frame and its mask as an image of any size; None shows nothing."""
        self._camera, self._image = camera, image

    def paint(self, painter: QPainter, camera: Camera) -> None:
        if self._camera is None or self._image is None:
            return
        if np.linalg.norm(self._camera.position - camera.position) > STANDING_IN:
            return
        turn = turned(self._camera, camera)
        k = self._camera.intrinsics
        corners = np.array([(0, 0, 1), (k.width, 0, 1), (k.width, k.height, 1), (0, k.height, 1)]) @ turn.T
        if (corners[:, 2] < 0.1).any():
            return  # a part is behind the camera
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.setTransform(QTransform(*(float(v) for v in turn.T.ravel())), True)
        painter.drawImage(QRectF(QPointF(0, 0), QPointF(k.width, k.height)), self._image)


def turned(source: Camera, target: Camera) -> NDArray[np.float64]:
    """(3, 3) homography from homogeneous pixels of `source` to those of `target`. Both cameras have one position. The
    third component of a result is positive in front of `target`."""
    turn: NDArray[np.float64] = _matrix(target) @ target.rotation.T @ source.rotation @ np.linalg.inv(_matrix(source))
    return turn


def _matrix(camera: Camera) -> NDArray[np.float64]:
    k = camera.intrinsics
    return np.array([(k.fx, 0, k.cx), (0, k.fy, k.cy), (0, 0, 1)])
