"""The preferences: a page of settings that apply at once, the table of keys, and one search for both."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QFrame,
    QGroupBox,
    QLineEdit,
    QScrollArea,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from app.look.dialog_buttons import DialogButtons
from app.look.labels import Label
from app.look.number_box import NumberBox
from app.look.plain_text import tip
from app.panels.key_bindings import KeyBindings
from app.panels.key_page import KeyPage
from app.panels.preferences import PREFERENCES, Preference, Preferences, Value

_Editor = QComboBox | QCheckBox | NumberBox


class PreferenceDialog(QDialog):
    """A non-modal dialog. The window shows every change at once."""

    def __init__(self, preferences: Preferences, bindings: KeyBindings, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Preferences")
        self.setWindowFlag(Qt.WindowType.Tool)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._preferences = preferences
        self.search = QLineEdit(self)
        self.search.setPlaceholderText("Search settings, commands and keys")
        self.search.setAccessibleName("Search the preferences")
        self.search.setClearButtonEnabled(True)
        self.editors: dict[str, _Editor] = {}
        self._groups: list[tuple[QGroupBox, QFormLayout, list[Preference]]] = []
        self.keys = KeyPage(bindings, self)
        self.nothing = Label("No setting matches.", self)
        self.tabs = QTabWidget(self)
        self.tabs.addTab(self._settings_page(), "Settings")
        self.tabs.addTab(self.keys, "Keys")
        self.buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        defaults = self.buttons.addButton("Restore all settings", QDialogButtonBox.ButtonRole.ResetRole)
        defaults.setToolTip("Restore the defaults of all settings; the keys have a separate button")
        defaults.clicked.connect(preferences.reset)
        defaults.setAutoDefault(False)
        self.buttons.rejected.connect(self.close)
        layout = QVBoxLayout(self)
        layout.addWidget(self.search)
        layout.addWidget(self.tabs, 1)
        layout.addWidget(self.buttons)
        self.search.textChanged.connect(self._find)
        preferences.changed.connect(self._show)
        self._find("")
        self.resize(720, 480)
        self.search.setFocus()

    def _settings_page(self) -> QWidget:
        page = QWidget(self)
        column = QVBoxLayout(page)
        for title in dict.fromkeys(p.group for p in PREFERENCES):
            box, rows = QGroupBox(title, page), QFormLayout()
            box.setLayout(rows)
            mine = [p for p in PREFERENCES if p.group == title]
            for preference in mine:
                editor = self.editors[preference.key] = self._made(preference, box)
                rows.addRow(preference.title, editor)
            column.addWidget(box)
            self._groups.append((box, rows, mine))
        column.addWidget(self.nothing)
        column.addStretch(1)
        area = QScrollArea(self)
        area.setWidgetResizable(True)
        area.setFrameShape(QFrame.Shape.NoFrame)
        area.setWidget(page)
        area.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        return area

    def _made(self, preference: Preference, parent: QWidget) -> _Editor:
        value, take = self._preferences[preference.key], partial(self._take, preference.key)
        editor: _Editor
        if preference.choices:
            editor = QComboBox(parent)
            for each, words in preference.choices.items():
                editor.addItem(words, each)
            editor.setCurrentIndex(editor.findData(value))
            editor.activated.connect(partial(self._take_choice, preference.key))
        elif isinstance(value, bool):
            editor = QCheckBox(parent)
            editor.setChecked(value)
            editor.toggled.connect(take)
        else:
            editor = NumberBox(
                preference.title, preference.low, preference.high, float(value),
                preference.decimals, preference.step, preference.unit, parent,
            )  # fmt: skip
            editor.setSpecialValueText(preference.nothing)
            editor.valueChanged.connect(take)
        editor.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        editor.installEventFilter(self)
        editor.setToolTip(tip(f"{preference.words}."))
        editor.setAccessibleName(preference.title)
        editor.setAccessibleDescription(preference.words)
        return editor

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Ignores the wheel, so that scrolling does not change the control under the mouse pointer."""
        if event.type() == QEvent.Type.Wheel:
            event.ignore()
            return True
        return super().eventFilter(watched, event)

    def _take(self, key: str, value: Value) -> None:
        self._preferences.set(key, value)

    def _take_choice(self, key: str, _: int) -> None:
        editor = self.editors[key]
        assert isinstance(editor, QComboBox)
        self._preferences.set(key, str(editor.currentData()))

    def _show(self, key: str) -> None:
        """Shows a value that was changed elsewhere."""
        editor, value = self.editors[key], self._preferences[key]
        editor.blockSignals(True)
        if isinstance(editor, QComboBox):
            editor.setCurrentIndex(editor.findData(value))
        elif isinstance(editor, QCheckBox):
            editor.setChecked(bool(value))
        else:
            editor.setValue(float(value))
        editor.blockSignals(False)

    def _find(self, typed: str) -> None:
        words, count = typed.casefold().split(), 0
        for box, rows, mine in self._groups:
            fitting = [p for p in mine if all(word in _searched(p) for word in words)]
            for preference in mine:
                rows.setRowVisible(self.editors[preference.key], preference in fitting)
            box.setVisible(bool(fitting))
            count += len(fitting)
        self.nothing.setVisible(not count)
        found = self.keys.search(typed)
        self.tabs.setTabText(0, f"Settings ({count})" if words else "Settings")
        self.tabs.setTabText(1, f"Keys ({found})" if words else "Keys")
        if words and not count and found:
            self.tabs.setCurrentIndex(1)
        elif words and count and not found:
            self.tabs.setCurrentIndex(0)


def _searched(preference: Preference) -> str:
    """The text that the search examines."""
    return " ".join((preference.group, preference.title, preference.words, *preference.choices.values())).casefold()
