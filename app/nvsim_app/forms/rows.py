"""The rows of a form: name, editor, unit, the paper's value, a reset button, and the help below; and the editors, one
class per kind of value."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent, QWheelEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLineEdit,
    QSizePolicy,
    QWidget,
)

from nvsim.files.user_folders import home_folder
from nvsim_app.forms.fields import Field
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import tool_button

_NOWHERE = object()
_CODE = re.compile(r"`(?!nvsim )([^`]*)`")  # names in the help; `in_window` replaces commands


class OptionRow(QWidget):
    """One option of a form. changed() is emitted when the user changes the value."""

    changed = Signal()

    def __init__(self, field: Field, paper: object = _NOWHERE, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.field = field
        self.editor = editor_of(field, self)
        self.editor.show_value(field.default)
        self._name = Label(field.name, self, minimumWidth=150)
        self._name.setBuddy(self.editor)
        self._origin = Label(self)
        quiet = self._origin.palette().ColorRole.PlaceholderText
        self._origin.setForegroundRole(quiet)
        self._origin.setMinimumWidth(190)
        self._origin.setWordWrap(True)
        self._paper = "" if paper is _NOWHERE else f"paper {value_text(paper)}"
        self.reset_button = tool_button("↺", self, self.reset, autoRaise=True)
        policy = self.reset_button.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.reset_button.setSizePolicy(policy)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 4, 0, 8)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(4)
        grid.addWidget(self._name, 0, 0)
        grid.addWidget(self.editor, 0, 1)
        grid.addWidget(self._origin, 0, 2)
        grid.addWidget(self.reset_button, 0, 3)
        grid.setColumnStretch(1, 1)
        if field.help:
            help = Label(_CODE.sub("“\\1”", field.help), self, wordWrap=True, selectable=True)
            help.setForegroundRole(quiet)
            help.setMinimumWidth(380)  # without it, the label's height is computed for a narrow column
            help.setContentsMargins(0, 0, 0, 4)
            grid.addWidget(help, 1, 0, 1, 4)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        self.editor.changed.connect(self._on_changed)
        self._mark()

    @property
    def is_changed(self) -> bool:
        """Whether the value differs from the default or is not valid."""
        try:
            return bool(self.editor.value() != self.field.default)
        except ValueError:
            return True

    def show_value(self, value: object) -> None:
        self.editor.show_value(value)
        self._mark()

    def show_field(self, field: Field) -> None:
        """Shows the option with the default of another preset, and sets the value to it."""
        self.field = self.editor.field = field
        self.show_value(field.default)

    def reset(self) -> None:
        """Resets the value to the default."""
        self.show_value(self.field.default)

    def matches(self, words: str) -> bool:
        """Whether the name, flag, section, and help together contain all words."""
        text = f"{self.field.name} {self.field.flag} {self.field.section} {self.field.help}".lower()
        return all(word in text for word in words.lower().split())

    def _on_changed(self) -> None:
        self._mark()
        self.changed.emit()

    def _mark(self) -> None:
        changed = self.is_changed
        self._name.setFont(type_font(bold=changed))
        default = value_text(self.field.default)
        self.reset_button.setVisible(changed)
        self.reset_button.setToolTip(tooltip_text(f"Reset to {default}"))
        words = [f"default {default}"] if changed else []
        if self._paper and self._paper != f"paper {default}" or (changed and self._paper):
            words.append(self._paper)
        self._origin.setText(", ".join(words))


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
                tooltip_text(
                    f"One or more of {', '.join(field.choices)}" if field.choices else "Values separated by spaces"
                )
            )
        if field.kind in self.WIDE:
            self.line.setMinimumWidth(180)
            self._row.addWidget(self.line, 1)
        else:
            self.line.setFixedWidth(110)
            self.line.setAlignment(Qt.AlignmentFlag.AlignRight)
            self._row.addWidget(self.line)
        if field.kind == "path":
            button = tool_button("Browse…", self, self._browse, "Select a path")
            self._row.addWidget(button)
        elif field.kind not in self.WIDE:
            unit = Label(field.unit, self, quiet=True)
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
        here = self.line.text() or str(home_folder())
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
