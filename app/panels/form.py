"""A small form for numbers and choices, with a button that runs an operation. It stays open, so that users can try
several values."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QVBoxLayout,
    QWidget,
)

from app.look.labels import Label
from app.look.plain_text import tip
from app.look.widgets import DialogButtons, NumberBox
from nvsim.graph.offers import Choice, Number


class Form(QDialog):
    """Calls `run` with the entered values by name. Stores the values in the settings under `key`."""

    def __init__(
        self,
        key: str,
        title: str,
        words: str,
        fields: tuple[Number | Choice, ...],
        run: Callable[[dict[str, Any]], object],
        settings: QSettings,
        parent: QWidget,
        button: str = "Apply",
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle(title)
        self.setWindowFlag(Qt.WindowType.Tool)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._key, self._settings, self._run = key, settings, run
        self._fields = fields
        self.inputs: dict[str, NumberBox | QComboBox] = {}
        label = Label(words, self)
        label.setWordWrap(True)
        label.setMinimumWidth(300)
        rows = QFormLayout()
        for field in fields:
            rows.addRow(field.title, self._made(field))
        self.buttons = DialogButtons(self)
        self.apply = self.buttons.addButton(button, QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.addButton(QDialogButtonBox.StandardButton.Close)
        self.apply.clicked.connect(self.run)
        self.buttons.rejected.connect(self.close)
        layout = QVBoxLayout(self)
        layout.setSpacing(8)
        layout.addWidget(label)
        layout.addLayout(rows)
        layout.addWidget(self.buttons)

    def _made(self, field: Number | Choice) -> QWidget:
        stored = self._settings.value(f"forms/{self._key}/{field.name}")
        if isinstance(field, Choice):
            choice = QComboBox(self)
            for value, words in field.answers.items():
                choice.addItem(words, value)
            words_of = [str(value) for value in field.answers]
            choice.setCurrentIndex(words_of.index(str(stored)) if str(stored) in words_of else 0)
            choice.setToolTip(tip(field.tip))
            self.inputs[field.name] = choice
            return choice
        try:
            value = field.default if stored is None else float(str(stored))
        except ValueError:
            value = math.nan
        value = field.default if math.isnan(value) else value  # the stored value may not be a number
        step = 1 if field.decimals == 0 else 0.1
        number = NumberBox(field.title, field.low, field.high, value, field.decimals, step, field.unit, self)
        number.setToolTip(tip(field.tip))
        self.inputs[field.name] = number
        return number

    @property
    def values(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, widget in self.inputs.items():
            found[name] = widget.value() if isinstance(widget, NumberBox) else widget.currentData()
        return found

    def run(self) -> None:
        """Stores the entered values and runs the operation."""
        for name, value in self.values.items():
            self._settings.setValue(f"forms/{self._key}/{name}", value)
        self._run(self.values)
