"""What can be laid over a frame: its floor mask, ignored pixels, its depth, normals, and the masks that the hybrid
segmentation passes through."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QSlider, QWidget

from app.frames.pictures import Painted
from app.look.icons import swatch
from app.look.plain_text import tip

FLOOR_COLOR = "#2ec4b6"


@dataclass
class FrameLayer:
    """name     also its key in the settings
    color    of its mask, "" for an image of many colours
    painted  None while it is not known
    opacity  0 to 1
    """

    name: str
    title: str
    tip: str
    color: str
    shown: bool
    opacity: float
    painted: Painted | None = None


def standard_layers() -> tuple[FrameLayer, ...]:
    """In the order in which they are painted."""
    return (
        FrameLayer("depth", "Depth of the images", "Estimated from this image and its neighbours; near is bright",
                   "", False, 0.8),
        FrameLayer("views", "Confidence of the depth", "How many other images confirm it; eight are bright",
                   "", False, 0.8),
        FrameLayer("normals", "Normals", "Which way surfaces face, by the cloud or a network", "", False, 0.8),
        FrameLayer("semantic", "Looks like floor", "M_sem: what has the floor's colours, or a network takes for it",
                   "#b07aa1", False, 0.55),
        FrameLayer("horizontal", "Lies flat", "M_norm: normals within 26° of straight up; desks are flat too",
                   "#4e79a7", False, 0.55),
        FrameLayer("prompted", "Grown from prompts", "M_final of the hybrid segmentation: what three points of both "
                   "others give on the map of normals", "#f28e2b", False, 0.55),
        FrameLayer("machine", "Mask before correction", "The mask that the floors stage found",
                   "#edc948", False, 0.5),
        FrameLayer("floor", "Floor mask", "The mask that training uses", FLOOR_COLOR, True, 0.45),
        FrameLayer("ignored", "Ignored pixels", "What the mask of the capture excludes from depth, floor and training",
                   "#e15759", True, 0.6),
    )  # fmt: skip


OF_DEPTH = ("depth", "views")
"""Names of the layers that are there only where depth was estimated."""
OF_MASK = ("ignored",)
"""Names of the layers of frames with a mask in the capture."""
CANDIDATES = ("normals", "semantic", "horizontal", "prompted")
"""Names of the layers that another process has to make."""


class LayerList(QWidget):
    """A check box and a fade slider for each layer, the topmost first. changed(FrameLayer)."""

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
            box.setToolTip(tip(layer.tip))
            slider = QSlider(Qt.Orientation.Horizontal, self)
            slider.setRange(5, 100)
            slider.setValue(round(100 * layer.opacity))
            slider.setToolTip(tip(f"How strongly “{layer.title}” covers the image"))
            slider.setMinimumWidth(60)
            slider.setAccessibleName(f"Strength of {layer.title}")
            slider.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the keys with the page
            box.toggled.connect(lambda on, layer=layer: self._show(layer, on))
            slider.valueChanged.connect(lambda value, layer=layer: self._fade(layer, value))
            grid.addWidget(box, 2 * row, 0)
            grid.addWidget(slider, 2 * row + 1, 0)
            grid.setRowMinimumHeight(2 * row + 1, 20)
            self.boxes[layer.name], self.sliders[layer.name] = box, slider
        grid.setRowStretch(2 * len(layers), 1)
        self._grid, self._rows = grid, {layer.name: row for row, layer in enumerate(reversed(layers))}
        self.offer((*OF_DEPTH, *OF_MASK), False)

    def offer(self, names: tuple[str, ...], there: bool) -> None:
        """Shows or hides the rows of layers that not every frame has."""
        for name in names:
            self.boxes[name].setVisible(there)
            self.sliders[name].setVisible(there)
            self._grid.setRowMinimumHeight(2 * self._rows[name] + 1, 20 if there else 0)

    @property
    def state(self) -> str:
        """What is shown and how strongly, in one line."""
        return " ".join(
            f"{name}:{int(box.isChecked())}:{self.sliders[name].value()}" for name, box in self.boxes.items()
        )

    def remember(self, state: str) -> None:
        """Brings `state` back; what is not understood is left out."""
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
