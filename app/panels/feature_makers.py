"""A panel beside the options of a feature export: the layouts, their readers, and the networks that compute them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtWidgets import QFrame, QVBoxLayout, QWidget

from app.look.labels import InkLabel, Label
from app.look.metrics import type_font
from app.look.plain_text import tip
from nvsim.networks.folder import models_folder
from nvsim.r2r.features.layouts import LAYOUTS, Layout, lacking, maker_of, role

WIDTH = 330  # pixels


class FeatureMakersPanel(QFrame):
    """Lists the layouts of features. `makers` holds a label for each layout, with the network that computes it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.setFixedWidth(WIDTH)
        column = QVBoxLayout(self)
        column.setSpacing(4)
        self._names: dict[str, Label] = {}
        self.makers: dict[str, InkLabel] = {}
        for layout in LAYOUTS.values():
            self._names[layout.name] = self._words()
            self.makers[layout.name] = self._words()
            self._names[layout.name].setText(f"{layout.name}: {layout.readers}")
            self._names[layout.name].setToolTip(tip(f"{layout.file}, {_numbers(layout)}"))
            for label in (self._names[layout.name], self.makers[layout.name]):
                column.addWidget(label)
            column.addSpacing(6)
        self.folder = self._words()
        self.folder.setText(
            f"To use another network for a layout, put it with its description into {models_folder()}, for example "
            f"{role(LAYOUTS['clip-b16'])}.onnx and .toml."
        )
        column.addWidget(self.folder)
        column.addStretch(1)
        self.show_makers((), None, False)

    def show_makers(self, chosen: Sequence[str], model: Path | None, projection: bool) -> None:
        """Shows what computes each layout. The `chosen` layouts are bold."""
        for layout in LAYOUTS.values():
            name, words = self._names[layout.name], self.makers[layout.name]
            name.setFont(type_font(bold=layout.name in chosen))
            missing = lacking(layout)
            words.setText(missing or f"by {maker_of(layout, model, projection).words}")
            words.set_ink("warning" if missing else "")

    def _words(self) -> InkLabel:
        label = InkLabel("", self)
        label.setWordWrap(True)
        return label


def _numbers(layout: Layout) -> str:
    return (
        f"{layout.tokens} x {layout.width} numbers per candidate"
        if layout.tokens
        else f"{layout.width} numbers per view"
    )
