"""The layers over the 3D view, top layer first, each with a check box and an opacity slider."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QPalette, QShowEvent
from PySide6.QtWidgets import QCheckBox, QFrame, QGridLayout, QScrollArea, QSlider, QWidget

from nvsim_app.look.boxes import STRETCH, vbox
from nvsim_app.look.plain_text import caption, tooltip_text
from nvsim_app.state.document import Document
from nvsim_app.views.overlays import Overlays


class LayersPanel(QScrollArea):
    """Shows which layers are visible and how opaque they are, and changes both."""

    def __init__(self, overlays: Overlays, document: Document) -> None:
        super().__init__(widgetResizable=True)
        self.setObjectName("layersPanel")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self._overlays = overlays
        self.boxes: dict[str, QCheckBox] = {}
        self.sliders: dict[str, QSlider] = {}
        self._names: tuple[str, ...] = ()
        overlays.changed.connect(self._update_rows)
        document.contentsChanged.connect(self._update_rows)
        document.selectionChanged.connect(self._update_rows)
        self._update_rows()

    def showEvent(self, event: QShowEvent) -> None:
        self._update_rows()
        super().showEvent(event)

    def _update_rows(self, _: object = None) -> None:
        names = tuple(layer.name for layer in self._overlays.layers)
        if names != self._names:
            self._names = names
            self._build()
        for layer in self._overlays.layers:
            box, slider = self.boxes[layer.name], self.sliders[layer.name]
            for widget in (box, slider):
                widget.blockSignals(True)
            box.setChecked(layer.shown)
            if not slider.isSliderDown():
                slider.setValue(round(100 * layer.opacity))
            for widget in (box, slider):
                widget.blockSignals(False)
            missing = getattr(layer, "missing", "")
            slider.setEnabled(layer.shown)
            # The box stays enabled. Its state takes effect as soon as there is something to draw.
            box.setText(caption(layer.title))
            box.setToolTip(tooltip_text(f"Nothing to draw: {missing}." if missing else f"Draw: {layer.title}"))
            palette = QPalette()  # the other colors stay those of the theme
            if missing:
                palette.setColor(palette.ColorRole.WindowText, self.palette().placeholderText().color())
            box.setPalette(palette)
            slider.setToolTip(tooltip_text(f"{round(100 * layer.opacity)} %"))

    def _build(self) -> None:
        inside = QWidget()
        grid = QGridLayout()
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(4)
        grid.setColumnStretch(1, 1)
        self.boxes, self.sliders = {}, {}
        for row, layer in enumerate(reversed(self._overlays.layers)):
            box = QCheckBox(layer.title)
            slider = QSlider(Qt.Orientation.Horizontal)
            slider.setRange(5, 100)
            slider.setMinimumWidth(40)
            slider.setAccessibleName(f"Opacity of {layer.title}")
            box.toggled.connect(lambda on, name=layer.name: self._overlays.set_shown(name, on))
            slider.valueChanged.connect(lambda v, name=layer.name: self._overlays.set_opacity(name, v / 100))
            grid.addWidget(box, row, 0)
            grid.addWidget(slider, row, 1)
            self.boxes[layer.name], self.sliders[layer.name] = box, slider
        vbox(grid, STRETCH, on=inside, margins=8)
        self.setWidget(inside)
