"""What a layer over the 3D view is."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtGui import QPainter

from nvsim.geometry.camera import Camera


class PaintsOver(Protocol):
    """What `Overlays.add` takes.

    name      its key in the settings
    title     what a user reads
    shown     whether it is drawn
    opacity   0 to 1
    """

    name: str
    title: str
    shown: bool
    opacity: float

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """Draws over an image that `camera` took, scaled to the widget's logical pixels. The painter's opacity is set;
        its state is put back afterwards."""
        ...


class Layer:
    """The usual layer: subclasses say `name`, `title`, how they begin, and paint."""

    name = ""
    title = ""
    shown = True
    opacity = 1.0
    moving = False
    """Set before each painting: whether the camera is on its way, so that coarse now is better than fine too late."""

    @property
    def missing(self) -> str:
        """Why there is nothing to draw, in words; "" when there is."""
        return ""

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """As PaintsOver says."""
