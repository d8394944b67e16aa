"""The field of a number. It is the same everywhere, so that numbers are entered in one way."""

from __future__ import annotations

from PySide6.QtGui import QValidator, QWheelEvent
from PySide6.QtWidgets import QDoubleSpinBox, QWidget


class NumberBox(QDoubleSpinBox):
    """A number with steps. `valueChanged` is emitted on Enter, when the focus leaves, and for steps, but not while the
    user types. The decimal sign is a point or a comma. The wheel scrolls the page, not the number.

    suffix  unit after the number
    """

    def __init__(
        self,
        name: str,
        low: float,
        high: float,
        value: float,
        decimals: int = 2,
        step: float = 1.0,
        suffix: str = "",
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.setAccessibleName(name)
        self.setKeyboardTracking(False)
        self.setDecimals(decimals)
        self.setRange(low, high)
        self.setSingleStep(step)
        self.setSuffix(suffix)
        self.setValue(value)

    def validate(self, text: str, place: int) -> tuple[QValidator.State, str, int]:
        """Accepts a comma as the decimal sign."""
        return super().validate(self._with_own_sign(text), place)

    def valueFromText(self, text: str) -> float:
        return super().valueFromText(self._with_own_sign(text))

    def _with_own_sign(self, text: str) -> str:
        own = self.locale().decimalPoint()
        return text.replace("," if own == "." else ".", own)

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()
