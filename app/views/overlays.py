"""What is drawn over the reconstruction: layers, one over the other, each shown or hidden and faded by itself."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QPainter

from app.layers.cloud import CloudLayer
from app.layers.frusta import FrustumLayer, SelectedFrameLayer
from app.layers.graph import GraphLayer
from app.layers.grid import GridLayer
from app.layers.labels import LabelLayer
from app.layers.layer import Layer, PaintsOver
from app.layers.occupancy import OccupancyLayer
from app.layers.trajectory import TrajectoryLayer
from app.state.document import Document
from nvsim.geometry.camera import Camera


class Overlays(QObject):
    """changed(): a layer came, went, was shown, hidden or faded; the view is to be painted again.

    Parts add layers of their own; a layer whose content changed needs `scene.update()`, not this signal.
    """

    changed = Signal()

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.grid = GridLayer(document)
        self.graph = GraphLayer(document, self, self.changed.emit)
        self._layers: list[PaintsOver] = []
        self._remembered: dict[str, tuple[bool, float]] = {}
        for layer in (
            self.grid,
            OccupancyLayer(document),
            CloudLayer(document),
            TrajectoryLayer(document),
            FrustumLayer(document),
            self.graph,
            LabelLayer(document, self.graph),
            SelectedFrameLayer(document),
        ):
            self.add(layer)

    @property
    def layers(self) -> tuple[PaintsOver, ...]:
        """The lowest first."""
        return tuple(self._layers)

    def __getitem__(self, name: str) -> PaintsOver:
        """Raises KeyError where no layer has this name."""
        for layer in self._layers:
            if layer.name == name:
                return layer
        raise KeyError(name)

    def add(self, layer: PaintsOver, below: str = "") -> None:
        """Puts a layer on top, or right below another. It begins as a user last had the layer of its name. Raises
        ValueError when there is one of that name, KeyError when there is none named `below`."""
        if any(layer.name == other.name for other in self._layers):
            raise ValueError(f"there is a layer {layer.name!r} already")
        place = self._layers.index(self[below]) if below else len(self._layers)
        self._layers.insert(place, layer)
        if layer.name in self._remembered:
            layer.shown, layer.opacity = self._remembered[layer.name]
        self.changed.emit()

    def remove(self, name: str) -> None:
        """Takes a layer away. Raises KeyError where no layer has this name."""
        self._layers.remove(self[name])
        self.changed.emit()

    def set_shown(self, name: str, shown: bool) -> None:
        """Raises KeyError where no layer has this name."""
        layer = self[name]
        if layer.shown != shown:
            layer.shown = shown
            self.changed.emit()

    def set_opacity(self, name: str, opacity: float) -> None:
        """`opacity` 0 to 1. Raises KeyError where no layer has this name."""
        layer, wanted = self[name], min(max(opacity, 0.0), 1.0)
        if layer.opacity != wanted:
            layer.opacity = wanted
            self.changed.emit()

    @property
    def state(self) -> dict[str, tuple[bool, float]]:
        """Layer name -> (shown, opacity), those among them that were remembered and are not there now."""
        return self._remembered | {layer.name: (layer.shown, layer.opacity) for layer in self._layers}

    def remember(self, state: Mapping[str, tuple[bool, float]]) -> None:
        """Brings `state` back, also for layers that are added later."""
        self._remembered = dict(state)
        for layer in self._layers:
            if layer.name in state:
                layer.shown, layer.opacity = state[layer.name]
        self.changed.emit()

    def paint(self, painter: QPainter, camera: Camera, moving: bool = False) -> None:
        """Draws what is shown over an image that `camera` took, scaled to the widget's logical pixels; coarser where
        the camera is `moving`."""
        for layer in self._layers:
            if layer.shown and layer.opacity > 0:
                if isinstance(layer, Layer):
                    layer.moving = moving
                painter.save()
                painter.setRenderHint(QPainter.RenderHint.Antialiasing)
                painter.setOpacity(layer.opacity)
                layer.paint(painter, camera)
                painter.restore()
