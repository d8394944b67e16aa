"""The rows of a form: name, editor, unit, the paper's value, a reset button, and the help below."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QSizePolicy, QToolButton, QWidget

from app.forms.editors import editor_of, value_text
from app.forms.fields import Field
from app.look.labels import Label
from app.look.metrics import type_font
from app.look.plain_text import tip

_NOWHERE = object()


class Row(QWidget):
    """One option of a form. changed() is emitted when the user changes the value."""

    changed = Signal()

    def __init__(self, field: Field, paper: object = _NOWHERE, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.field = field
        self.editor = editor_of(field, self)
        self.editor.show_value(field.default)
        self._name = Label(field.name, self)
        self._name.setBuddy(self.editor)
        self._name.setMinimumWidth(150)
        self._origin = Label(self)
        quiet = self._origin.palette().ColorRole.PlaceholderText
        self._origin.setForegroundRole(quiet)
        self._origin.setMinimumWidth(190)
        self._paper = "" if paper is _NOWHERE else f"paper {value_text(paper)}"
        self.reset_button = QToolButton(self)
        self.reset_button.setText("↺")
        self.reset_button.setAutoRaise(True)
        self.reset_button.clicked.connect(self.reset)
        policy = self.reset_button.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.reset_button.setSizePolicy(policy)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 4, 0, 8)
        grid.setVerticalSpacing(4)
        grid.addWidget(self._name, 0, 0)
        grid.addWidget(self.editor, 0, 1)
        grid.addWidget(self._origin, 0, 2)
        grid.addWidget(self.reset_button, 0, 3)
        grid.setColumnStretch(1, 1)
        if field.help:
            help = Label(field.help, self)
            help.setWordWrap(True)
            help.setForegroundRole(quiet)
            help.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
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
        self.reset_button.setToolTip(tip(f"Reset to {default}"))
        words = [f"default {default}"] if changed else []
        if self._paper and self._paper != f"paper {default}" or (changed and self._paper):
            words.append(self._paper)
        self._origin.setText(", ".join(words))
