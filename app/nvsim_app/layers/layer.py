"""The interface and the base class of layers over the 3D view."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtGui import QPainter

from nvsim.geometry.camera import Camera


class PaintsOver(Protocol):
    """The interface that `Overlays.add` accepts.

    name      key in the settings
    title     label in the window
    shown     whether the layer is painted
    opacity   0 to 1
    """

    name: str
    title: str
    shown: bool
    opacity: float

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """Paints over the image of `camera`, whose intrinsics use logical pixels of the widget. The caller sets the
        opacity of the painter before, and restores its state afterward."""
        ...


class Layer:
    """The base class of layers. Subclasses set `name`, `title`, and the initial visibility, and implement `paint`."""

    name = ""
    title = ""
    shown = True
    opacity = 1.0
    moving = False
    """Set before each painting: whether the camera moves. A layer may then paint coarsely to be faster."""

    @property
    def missing(self) -> str:
        """Why there is nothing to paint, as text; "" if there is something."""
        return ""

    def release_project(self) -> None:
        """Releases what the layer keeps of the project, which is left."""

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """Paints the layer; see PaintsOver."""
