"""The stack of layers over the reconstruction. Each layer has its own visibility and opacity."""

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
    """The layers of the 3D view.

    changed(): a layer was added or removed, or its visibility or opacity changed; repaint the view. If the content of a
    layer changed, call `scene.update()` instead. Other parts of the window may add layers.
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
        document.projectLeft.connect(self._forget)

    def _forget(self) -> None:
        for layer in self._layers:
            if isinstance(layer, Layer):
                layer.forget()

    @property
    def layers(self) -> tuple[PaintsOver, ...]:
        """All layers, the lowest first."""
        return tuple(self._layers)

    def __getitem__(self, name: str) -> PaintsOver:
        """The layer with this name. Raises KeyError if there is none."""
        for layer in self._layers:
            if layer.name == name:
                return layer
        raise KeyError(name)

    def add(self, layer: PaintsOver, below: str = "") -> None:
        """Adds a layer on top, or directly below another one, with the stored visibility and opacity of its name.

        Raises ValueError if there is a layer with this name, KeyError if there is no layer named `below`."""
        if any(layer.name == other.name for other in self._layers):
            raise ValueError(f"a layer {layer.name!r} exists already")
        place = self._layers.index(self[below]) if below else len(self._layers)
        self._layers.insert(place, layer)
        if layer.name in self._remembered:
            layer.shown, layer.opacity = self._remembered[layer.name]
        self.changed.emit()

    def remove(self, name: str) -> None:
        """Removes a layer. Raises KeyError if no layer has this name."""
        self._layers.remove(self[name])
        self.changed.emit()

    def set_shown(self, name: str, shown: bool) -> None:
        """Shows or hides a layer. Raises KeyError if no layer has this name."""
        layer = self[name]
        if layer.shown != shown:
            layer.shown = shown
            self.changed.emit()

    def set_opacity(self, name: str, opacity: float) -> None:
        """Sets the opacity of a layer, limited to 0 to 1. Raises KeyError if no layer has this name."""
        layer, wanted = self[name], min(max(opacity, 0.0), 1.0)
        if layer.opacity != wanted:
            layer.opacity = wanted
            self.changed.emit()

    @property
    def state(self) -> dict[str, tuple[bool, float]]:
        """Layer name -> (shown, opacity), including stored states of layers that do not exist now."""
        return self._remembered | {layer.name: (layer.shown, layer.opacity) for layer in self._layers}

    def remember(self, state: Mapping[str, tuple[bool, float]]) -> None:
        """Restores `state`, also for layers that are added later."""
        self._remembered = dict(state)
        for layer in self._layers:
            if layer.name in state:
                layer.shown, layer.opacity = state[layer.name]
        self.changed.emit()

    def paint(self, painter: QPainter, camera: Camera, moving: bool = False) -> None:
        """Paints the visible layers over the image of `camera`, whose intrinsics use logical pixels of the widget.
        Layers may paint more coarsely if the camera is `moving`."""
        for layer in self._layers:
            if layer.shown and layer.opacity > 0:
                if isinstance(layer, Layer):
                    layer.moving = moving
                painter.save()
                painter.setRenderHint(QPainter.RenderHint.Antialiasing)
                painter.setOpacity(layer.opacity)
                layer.paint(painter, camera)
                painter.restore()
