"""A dialog that sets the scale of the project from a measured length whose true value is known."""

from __future__ import annotations

from collections.abc import Collection

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QFormLayout, QVBoxLayout, QWidget

from app.look import lengths
from app.look.labels import Label
from app.look.widgets import DialogButtons, NumberBox
from nvsim.project.work import PIPELINE, STAGE, StageName


class KnownLength(QDialog):
    """Asks for the true length. chosen(float): true length divided by measured length."""

    chosen = Signal(float)

    def __init__(self, metres: float, stages: Collection[StageName], parent: QWidget | None = None) -> None:
        """`metres` is the measured length; `stages` are the stages that have a result."""
        super().__init__(parent)
        self.setWindowTitle("Set the scale")
        self._metres = metres
        unit = lengths.unit()
        value = metres / unit.metres
        self.length = NumberBox("True length", 0.01, 10_000.0, value, 3, suffix=f" {unit.symbol}", parent=self)
        self.length.valueChanged.connect(self._show_state)
        self.words = Label(words_of(stages), self)
        self.words.setWordWrap(True)
        self.words.setMinimumWidth(380)
        form = QFormLayout()
        form.addRow("Measured length", Label(lengths.length(metres, 3), self))
        form.addRow("True length", self.length)
        self.change = Label(self)
        form.addRow("All lengths", self.change)
        self.buttons = DialogButtons(QDialogButtonBox.StandardButton.Cancel, self)
        self.apply = self.buttons.addButton("Import again with this scale", QDialogButtonBox.ButtonRole.AcceptRole)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        self.accepted.connect(lambda: self.chosen.emit(self.factor))
        layout = QVBoxLayout(self)
        layout.setSpacing(8)
        layout.addLayout(form)
        layout.addWidget(self.words)
        layout.addWidget(self.buttons)
        self.length.selectAll()
        self._show_state()

    @property
    def factor(self) -> float:
        """True length divided by measured length."""
        return self.length.value() * lengths.unit().metres / self._metres

    def _show_state(self) -> None:
        self.change.setText(f"become {100 * self.factor:.1f} % of their current values")


def words_of(stages: Collection[StageName]) -> str:
    """Explains which results of `stages` become out of date by a new import."""
    made = [STAGE[stage].result for stage in PIPELINE if stage in stages]
    if not made:
        return "The capture is imported again."
    listed = f"{', '.join(made[:-1])} and {made[-1]}" if len(made) > 1 else made[0]
    return (
        f"The capture is imported again. These results become out of date: {listed}. Run everything computes them "
        "again; Earlier results restores the current capture."
    )
