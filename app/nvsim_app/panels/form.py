"""Small dialogs that ask for numbers: a form that runs an operation and stays open, so that users can try several
values, and the true length of a measured line."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import Any

from PySide6.QtCore import QSettings, Qt, Signal
from PySide6.QtWidgets import QComboBox, QDialogButtonBox, QFormLayout, QWidget

from nvsim.graph.offers import ChoiceField, NumberField
from nvsim.project.work import PIPELINE, STAGE, StageName
from nvsim_app.look import lengths
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.widgets import Dialog, DialogButtons, NumberBox


class Form(Dialog):
    """Calls `run` with the entered values by name. Stores the values in the settings under `key`."""

    def __init__(
        self,
        key: str,
        title: str,
        words: str,
        fields: tuple[NumberField | ChoiceField, ...],
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
        label = Label(words, self, wordWrap=True, minimumWidth=300)
        rows = QFormLayout()
        for field in fields:
            rows.addRow(field.title, self._make_widget(field))
        self.buttons = DialogButtons(self)
        self.apply = self.buttons.addButton(button, QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.addButton(QDialogButtonBox.StandardButton.Close)
        self.apply.clicked.connect(self.run)
        self.buttons.rejected.connect(self.close)
        vbox(label, rows, self.buttons, on=self, spacing=8)

    def _make_widget(self, field: NumberField | ChoiceField) -> QWidget:
        stored = self._settings.value(f"forms/{self._key}/{field.name}")
        if isinstance(field, ChoiceField):
            choice = QComboBox(self)
            for value, words in field.answers.items():
                choice.addItem(words, value)
            words_of = [str(value) for value in field.answers]
            choice.setCurrentIndex(words_of.index(str(stored)) if str(stored) in words_of else 0)
            choice.setToolTip(tooltip_text(field.tip))
            self.inputs[field.name] = choice
            return choice
        try:
            value = field.default if stored is None else float(str(stored))
        except ValueError:
            value = math.nan
        value = field.default if math.isnan(value) else value  # the stored value may not be a number
        step = 1 if field.decimals == 0 else 0.1
        number = NumberBox(field.title, field.low, field.high, value, field.decimals, step, field.unit, self)
        number.setToolTip(tooltip_text(field.tip))
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


class KnownLength(Dialog):
    """Asks for the true length. chosen(float): true length divided by measured length."""

    chosen = Signal(float)

    def __init__(self, meters: float, stages: Collection[StageName], parent: QWidget | None = None) -> None:
        """`meters` is the measured length; `stages` are the stages that have a result."""
        super().__init__(parent)
        self.setWindowTitle("Set the scale")
        self._meters = meters
        unit = lengths.unit()
        value = meters / unit.meters
        self.length = NumberBox("True length", 0.01, 10_000.0, value, 3, suffix=f" {unit.symbol}", parent=self)
        self.length.valueChanged.connect(self._show_state)
        self.words = Label(outdated_results_text(stages), self, wordWrap=True, minimumWidth=380)
        form = QFormLayout()
        form.addRow("Measured length", Label(lengths.length(meters, 3), self))
        form.addRow("True length", self.length)
        self.change = Label(self)
        form.addRow("All lengths", self.change)
        self.buttons = DialogButtons(QDialogButtonBox.StandardButton.Cancel, self)
        self.apply = self.buttons.addButton("Import again with this scale", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        self.accepted.connect(lambda: self.chosen.emit(self.factor))
        vbox(form, self.words, self.buttons, on=self, spacing=8)
        self.length.selectAll()
        self._show_state()

    @property
    def factor(self) -> float:
        """True length divided by measured length."""
        return self.length.value() * lengths.unit().meters / self._meters

    def _show_state(self) -> None:
        self.change.setText(f"become {100 * self.factor:.1f} % of their current values")


def outdated_results_text(stages: Collection[StageName]) -> str:
    """Explains which results of `stages` become out of date by a new import."""
    made = [STAGE[stage].result for stage in PIPELINE if stage in stages]
    if not made:
        return "The capture is imported again."
    listed = f"{', '.join(made[:-1])} and {made[-1]}" if len(made) > 1 else made[0]
    return (
        f"The capture is imported again. These results become out of date: {listed}. Run everything computes them "
        "again; Earlier results restores the current capture."
    )
