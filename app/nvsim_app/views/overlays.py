"""Over the reconstruction: the stack of layers, and the status texts."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QObject, QPoint, QPointF, QRect, QSize, Qt, Signal
from PySide6.QtGui import QColor, QLinearGradient, QPainter, QPalette

from nvsim.geometry.camera import Camera
from nvsim_app.drawing.render_child import WHOLE, Picture
from nvsim_app.layers.capture import CloudLayer, FrustumLayer, SelectedFrameLayer, TrajectoryLayer
from nvsim_app.layers.floor import GridLayer, OccupancyLayer
from nvsim_app.layers.graph import GraphLayer
from nvsim_app.layers.labels import LabelLayer
from nvsim_app.layers.layer import Layer, PaintsOver
from nvsim_app.look import lengths
from nvsim_app.look.plain_text import plain
from nvsim_app.look.theme import type_font
from nvsim_app.painting.cameras import ViewPose, heading_degrees
from nvsim_app.painting.primitives import paint_label
from nvsim_app.state.document import Document


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
        document.projectLeft.connect(self._release_project)

    def _release_project(self) -> None:
        for layer in self._layers:
            if isinstance(layer, Layer):
                layer.release_project()

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


def paint_ground(painter: QPainter, size: QSize, palette: QPalette) -> None:
    """Paints the background that is shown if there is no image."""
    dark = palette.window().color().lightness() < 128
    gradient = QLinearGradient(0, 0, 0, size.height())
    gradient.setColorAt(0, QColor("#242a33" if dark else "#eef2f6"))
    gradient.setColorAt(1, QColor("#14171c" if dark else "#cfd8e1"))
    painter.fillRect(QRect(QPoint(0, 0), size), gradient)


def paint_status(painter: QPainter, size: QSize, pose: ViewPose, picture: Picture | None, words: str) -> None:
    """Paints the pose and as many facts about the image as fit at the lower left, and `words` at the top center if
    there are any."""
    painter.setFont(type_font("small"))
    ink, fill = QColor("#dfe7ee"), QColor(16, 20, 26, 175)
    x, y, z = pose.position
    facts = [lengths.position_text(x, y, z, decimals=1), f"{heading_degrees(pose):.0f}°"]
    if picture is not None:
        k = picture.request.camera.intrinsics
        facts += ["whole building" if picture.submap == WHOLE else f"submap {picture.submap}", f"{k.width}×{k.height}"]
        facts += [f"{picture.renderer} {picture.milliseconds:.0f} ms"]
    while len(facts) > 1 and painter.fontMetrics().horizontalAdvance("   ".join(facts)) > size.width() - 32:
        facts.pop()
    paint_label(painter, QPointF(10, size.height() - 10), "   ".join(facts), ink, fill)
    if words:
        box = QRect(QPoint(0, 0), size).adjusted(16, 8, -16, -8)
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop | Qt.TextFlag.TextWordWrap
        needed = painter.boundingRect(box, flags, plain(words))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(fill)
        painter.drawRoundedRect(needed.adjusted(-6, -2, 6, 2), 4, 4)
        painter.setPen(ink)
        painter.drawText(needed, flags, plain(words))
