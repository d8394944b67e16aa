"""The widgets that edit one option, one class per kind of value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent, QWheelEvent
from PySide6.QtWidgets import QCheckBox, QComboBox, QFileDialog, QHBoxLayout, QLineEdit, QToolButton, QWidget

from app.forms.fields import Field
from app.look.labels import Label
from app.look.plain_text import tip
from nvsim.files.user_folders import home


class Editor(QWidget):
    """The widget that edits one option. changed() is emitted when the user changes the value."""

    changed = Signal()

    def __init__(self, field: Field, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.field = field
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(0, 0, 0, 0)
        self._row.setSpacing(4)

    def value(self) -> Any:
        """The entered value. Raises ValueError with a sentence for the user if it is not valid."""
        raise NotImplementedError(self.field.kind)

    def show_value(self, value: object) -> None:
        """Shows `value` in the widget."""
        raise NotImplementedError(self.field.kind)


class SwitchEditor(Editor):
    """A checkbox for an option that is on or off."""

    def __init__(self, field: Field, parent: QWidget | None = None) -> None:
        super().__init__(field, parent)
        self.box = QCheckBox(self)
        self.box.toggled.connect(lambda _: self.changed.emit())
        self._row.addWidget(self.box)
        self._row.addStretch(1)
        self.setFocusProxy(self.box)

    def value(self) -> bool:
        return self.box.isChecked()

    def show_value(self, value: object) -> None:
        self.box.setChecked(bool(value))


class _Choice(QComboBox):
    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()  # scrolling through a form must not change the option under the pointer


class ChoiceEditor(Editor):
    """A drop-down list for an option with fixed choices."""

    def __init__(self, field: Field, parent: QWidget | None = None) -> None:
        super().__init__(field, parent)
        self.box = _Choice(self)
        self.box.addItems(field.choices)
        self.box.setMinimumWidth(110)
        self.box.currentIndexChanged.connect(lambda _: self.changed.emit())
        self._row.addWidget(self.box)
        self._row.addStretch(1)
        self.setFocusProxy(self.box)

    def value(self) -> str:
        return self.box.currentText()

    def show_value(self, value: object) -> None:
        self.box.setCurrentText(str(value))


class _Line(QLineEdit):
    """A text field in which the Up and Down keys change a number in steps."""

    def __init__(self, step: Callable[[int], None], parent: QWidget) -> None:
        super().__init__(parent)
        self._step = step

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Up, Qt.Key.Key_Down):
            self._step(1 if event.key() == Qt.Key.Key_Up else -1)
            return
        super().keyPressEvent(event)


class LineEditor(Editor):
    """A text field for a number, a text, a path, or several values separated by spaces. If the option is optional, an
    empty field means None."""

    WIDE = ("path", "text", "several")

    def __init__(self, field: Field, parent: QWidget | None = None) -> None:
        super().__init__(field, parent)
        self.line = _Line(self._step, self)
        if field.optional:
            self.line.setPlaceholderText("automatic" if field.kind in ("count", "number") else "not set")
        if field.default == "":
            self.line.setPlaceholderText("not set")
        if field.kind == "several":
            self.line.setPlaceholderText("not set")
            self.line.setToolTip(
                tip(f"One or more of {', '.join(field.choices)}" if field.choices else "Values separated by spaces")
            )
        if field.kind in self.WIDE:
            self.line.setMinimumWidth(180)
            self._row.addWidget(self.line, 1)
        else:
            self.line.setFixedWidth(110)
            self.line.setAlignment(Qt.AlignmentFlag.AlignRight)
            self._row.addWidget(self.line)
        if field.kind == "path":
            button = QToolButton(self)
            button.setText("Browse…")
            button.setToolTip("Select a path")
            button.clicked.connect(self._browse)
            self._row.addWidget(button)
        elif field.kind not in self.WIDE:
            unit = Label(field.unit, self)
            unit.setForegroundRole(unit.palette().ColorRole.PlaceholderText)
            self._row.addWidget(unit)
            self._row.addStretch(1)
        self.line.textChanged.connect(lambda _: self.changed.emit())
        self.setFocusProxy(self.line)

    def value(self) -> Any:
        text, kind = self.line.text().strip(), self.field.kind
        if kind == "several":
            return self._several(text)
        if not text:
            if self.field.optional:
                return None
            if self.field.default == "":
                return ""
            raise ValueError(f"{self.field.name} is empty; enter a value or reset it.")
        try:
            return int(text) if kind == "count" else float(text.replace(",", ".")) if kind == "number" else text
        except ValueError:
            what = "a whole number" if kind == "count" else "a number"
            raise ValueError(f"{self.field.name} is “{text}”, which is not {what}.") from None

    def _several(self, text: str) -> tuple[Any, ...]:
        words = text.replace(",", " ").split()
        if self.field.choices:
            for word in words:
                if word not in self.field.choices:
                    raise ValueError(f"{self.field.name}: “{word}” is not one of {', '.join(self.field.choices)}.")
        try:
            return tuple(self.field.item(w) for w in words)
        except ValueError:
            raise ValueError(f"{self.field.name} is “{text}”; enter whole numbers separated by spaces.") from None

    def show_value(self, value: object) -> None:
        if isinstance(value, tuple | list):
            text = " ".join(str(v) for v in value)
        else:
            text = "" if value is None else number_text(value)
        if text != self.line.text():
            self.line.setText(text)
            self.line.setCursorPosition(0)

    def _step(self, sign: int) -> None:
        try:
            value = self.value()
        except ValueError:
            return
        if isinstance(value, int):
            self.show_value(value + sign * max(1, 10 ** (len(str(abs(value))) - 2)))
        elif isinstance(value, float):
            self.show_value(float(f"{value + sign * (abs(value) / 10 or 0.1):.3g}"))

    def _browse(self) -> None:
        here = self.line.text() or str(home())
        if any(word in self.field.path for word in ("csv", "picture", "lpips", "occupancy")) and (
            not self.field.path.endswith("pictures")
        ):
            reads = self.field.path.endswith(("lpips", "occupancy"))
            choose = QFileDialog.getOpenFileName if reads else QFileDialog.getSaveFileName
            chosen = choose(self, self.field.name, here)[0]
        else:
            chosen = QFileDialog.getExistingDirectory(self, self.field.name, here)
        if chosen:
            self.line.setText(chosen)


def number_text(value: object) -> str:
    """Formats a number for a text field: 0.0005, 2e-05, 20000."""
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return str(value)


def value_text(value: object) -> str:
    """Formats a value for a sentence: None as "automatic", a boolean as "on" or "off", an empty list as "all"."""
    if value is None:
        return "automatic"
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple | list):
        return ", ".join(str(v) for v in value) or "all"
    return number_text(value)


def editor_of(field: Field, parent: QWidget | None = None) -> Editor:
    """An empty editor for the field."""
    if field.kind == "switch":
        return SwitchEditor(field, parent)
    if field.kind == "choice":
        return ChoiceEditor(field, parent)
    return LineEditor(field, parent)
