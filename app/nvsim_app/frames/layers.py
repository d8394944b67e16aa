"""The layers that can be overlaid on a frame: floor masks, ignored pixels, depth, normals, and the intermediate masks
of the hybrid segmentation."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QSlider, QWidget

from nvsim_app.frames.pictures import PaintedImage
from nvsim_app.look.icons import swatch
from nvsim_app.look.plain_text import tooltip_text

FLOOR_COLOR = "#2ec4b6"


@dataclass
class FrameLayer:
    """One layer of the frame page.

    name     identifier, also the key in the settings
    color    color of a mask, "" for an image with many colors
    painted  the image, None if it is not available
    opacity  0 to 1
    """

    name: str
    title: str
    tip: str
    color: str
    shown: bool
    opacity: float
    painted: PaintedImage | None = None


def standard_layers() -> tuple[FrameLayer, ...]:
    """All layers in painting order."""
    return (
        FrameLayer("depth", "Estimated depth", "Estimated from this image and its neighbors; near is bright",
                   "", False, 0.8),
        FrameLayer("views", "Depth confidence", "How many other images confirm the depth; eight or more are brightest",
                   "", False, 0.8),
        FrameLayer("normals", "Normals", "Orientation of surfaces, from the point cloud or a network", "", False, 0.8),
        FrameLayer("semantic", "Looks like floor", "M_sem: pixels with floor colors, or floor according to a network",
                   "#b07aa1", False, 0.55),
        FrameLayer("horizontal", "Horizontal surfaces", "M_norm: normals within 26° of vertical, including desks",
                   "#4e79a7", False, 0.55),
        FrameLayer("prompted", "Grown from prompts", "M_final of the hybrid segmentation: the region grown on normals "
                   "from three points of both masks", "#f28e2b", False, 0.55),
        FrameLayer("machine", "Mask before correction", "The mask that the floors stage found",
                   "#edc948", False, 0.5),
        FrameLayer("floor", "Floor mask", "The mask that training uses", FLOOR_COLOR, True, 0.45),
        FrameLayer("ignored", "Ignored pixels", "Pixels that a mask of the capture excludes from depth, floor, and "
                   "training", "#e15759", True, 0.6),
    )  # fmt: skip


OF_DEPTH = ("depth", "views")
"""Names of the layers that exist only if depth was estimated."""
OF_MASK = ("ignored",)
"""Names of the layers that exist only for frames with a mask in the capture."""
CANDIDATES = ("normals", "semantic", "horizontal", "prompted")
"""Names of the layers that another process computes on request."""


class LayerList(QWidget):
    """A checkbox and an opacity slider for each layer, the topmost first. changed(FrameLayer) is emitted after a change
    of a layer."""

    changed = Signal(object)

    def __init__(self, layers: tuple[FrameLayer, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(4)
        self.boxes: dict[str, QCheckBox] = {}
        self.sliders: dict[str, QSlider] = {}
        for row, layer in enumerate(reversed(layers)):
            box = QCheckBox(layer.title, self)
            if layer.color:
                box.setIcon(swatch(layer.color, 10))
            box.setChecked(layer.shown)
            box.setToolTip(tooltip_text(layer.tip))
            slider = QSlider(Qt.Orientation.Horizontal, self)
            slider.setRange(5, 100)
            slider.setValue(round(100 * layer.opacity))
            slider.setToolTip(tooltip_text(f"Opacity of “{layer.title}”"))
            slider.setMinimumWidth(60)
            slider.setAccessibleName(f"Opacity of {layer.title}")
            slider.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the keyboard focus with the page
            box.toggled.connect(lambda on, layer=layer: self._show(layer, on))
            slider.valueChanged.connect(lambda value, layer=layer: self._fade(layer, value))
            grid.addWidget(box, 2 * row, 0)
            grid.addWidget(slider, 2 * row + 1, 0)
            grid.setRowMinimumHeight(2 * row + 1, 20)
            self.boxes[layer.name], self.sliders[layer.name] = box, slider
        grid.setRowStretch(2 * len(layers), 1)
        self._grid, self._rows = grid, {layer.name: row for row, layer in enumerate(reversed(layers))}
        self.show_optional((*OF_DEPTH, *OF_MASK), False)

    def show_optional(self, names: tuple[str, ...], there: bool) -> None:
        """Shows or hides the rows of optional layers."""
        for name in names:
            self.boxes[name].setVisible(there)
            self.sliders[name].setVisible(there)
            self._grid.setRowMinimumHeight(2 * self._rows[name] + 1, 20 if there else 0)

    @property
    def state(self) -> str:
        """Visibility and opacity of all layers as one line of text."""
        return " ".join(
            f"{name}:{int(box.isChecked())}:{self.sliders[name].value()}" for name, box in self.boxes.items()
        )

    def remember(self, state: str) -> None:
        """Restores `state`; invalid parts are ignored."""
        for word in state.split():
            name, *numbers = word.split(":")
            if name in self.boxes and len(numbers) == 2 and all(n.isdecimal() for n in numbers):
                self.boxes[name].setChecked(numbers[0] != "0")
                self.sliders[name].setValue(int(numbers[1]))

    def _show(self, layer: FrameLayer, on: bool) -> None:
        layer.shown = on
        self.changed.emit(layer)

    def _fade(self, layer: FrameLayer, value: int) -> None:
        layer.opacity = value / 100
        self.changed.emit(layer)
