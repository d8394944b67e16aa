"""The render from a frame's camera, requested from the window's rendering process."""

from __future__ import annotations

from itertools import count

import numpy as np
from PySide6.QtCore import QObject, QTimer, Signal

from app.drawing.render_child import Picture, Request
from app.frames.frame_data import FrameData
from app.frames.pictures import render
from app.views.scene_view import SceneView

_VIEW = "frame"  # view name that distinguishes these requests from those of the 3D view


class FrameRender(QObject):
    """Requests renders of the open frame.

    wanted()            the receiver must call `ask` with the current frame and scale
    rendered(Painted)   a new render
    """

    wanted = Signal()
    rendered = Signal(object)

    def __init__(self, scene: SceneView, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._scene = scene
        self._numbers = count()
        self._matter: FrameData | None = None
        self._soon = QTimer(self, singleShot=True, interval=30)
        self._soon.timeout.connect(self.wanted)
        scene.link.arrived.connect(self._on_picture)
        scene.link.opened.connect(self.soon)

    def soon(self) -> None:
        """Schedules `wanted` after the frame or its scale changed. Repeated calls delay it."""
        self._soon.start()

    def ask(self, matter: FrameData, scale: float, channel: str) -> None:
        """Requests a render at `scale` pixels per pixel of the photo, at most 1. `channel` is one of tones.CHANNELS."""
        self._matter = matter
        height, width = matter.image.shape[:2]
        size = max(1, round(width * min(1.0, scale))), max(1, round(height * min(1.0, scale)))
        camera, scene = matter.frame.camera.scaled(*size), self._scene
        number = next(self._numbers)
        scene.link.ask(Request(number, camera, channel, False, scene.renderer, _VIEW, values=True))

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view != _VIEW or self._matter is None:
            return
        if np.array_equal(picture.request.camera.camera_to_world, self._matter.frame.camera_to_world):
            self.rendered.emit(render(picture.pixels, picture.request.channel, picture.values))
