"""The dialog of the preferences: a page of settings that apply at once, the table of keys, and one search for both."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QEvent, QObject, QSignalBlocker, QSortFilterProxyModel, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialogButtonBox,
    QFormLayout,
    QFrame,
    QGroupBox,
    QHeaderView,
    QKeySequenceEdit,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QTableView,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.table import Column, Index, TableModel, table
from nvsim_app.look.widgets import Dialog, DialogButtons, NumberBox, named
from nvsim_app.panels.preferences import PREFERENCES, KeyBindings, KeyRow, Preference, Preferences

_Editor = QComboBox | QCheckBox | NumberBox


class PreferenceDialog(Dialog):
    """A non-modal dialog. The window shows every change at once."""

    def __init__(self, preferences: Preferences, bindings: KeyBindings, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Preferences")
        self.setWindowFlag(Qt.WindowType.Tool)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._preferences = preferences
        self.search = QLineEdit(self, placeholderText="Search settings, commands and keys", clearButtonEnabled=True)
        self.search.setAccessibleName("Search the preferences")
        self.editors: dict[str, _Editor] = {}
        self._groups: list[tuple[QGroupBox, QFormLayout, list[Preference]]] = []
        self.keys = KeyPage(bindings, self)
        self.nothing = Label("No setting matches.", self)
        self.tabs = QTabWidget(self)
        self.tabs.addTab(self._settings_page(), "Settings")
        self.tabs.addTab(self.keys, "Keys")
        self.buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        defaults = self.buttons.addButton("Reset to defaults", QDialogButtonBox.ButtonRole.ResetRole)
        defaults.setToolTip("Restore the defaults of all settings")
        self.tabs.currentChanged.connect(lambda page: defaults.setVisible(page == 0))  # the keys have their own
        defaults.clicked.connect(preferences.reset)
        defaults.setAutoDefault(False)
        self.buttons.rejected.connect(self.close)
        vbox(self.search, (self.tabs, 1), self.buttons, on=self)
        self.search.textChanged.connect(self._find)
        preferences.changed.connect(self._show)
        self._find("")
        self.resize(860, 520)
        self.search.setFocus()

    def _settings_page(self) -> QWidget:
        page = QWidget(self)
        column = QVBoxLayout(page)
        for title in dict.fromkeys(p.group for p in PREFERENCES):
            box, rows = QGroupBox(title, page), QFormLayout()
            box.setLayout(rows)
            mine = [p for p in PREFERENCES if p.group == title]
            for preference in mine:
                editor = self.editors[preference.key] = self._make_editor(preference, box)
                rows.addRow(preference.title, editor)
            column.addWidget(box)
            self._groups.append((box, rows, mine))
        column.addWidget(self.nothing)
        column.addStretch(1)
        area = QScrollArea(self, widgetResizable=True)
        area.setFrameShape(QFrame.Shape.NoFrame)
        area.setWidget(page)
        area.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        return area

    def _make_editor(self, preference: Preference, parent: QWidget) -> _Editor:
        value, take = self._preferences[preference.key], partial(self._preferences.set, preference.key)
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
        editor.setToolTip(tooltip_text(f"{preference.words}."))
        editor.setAccessibleName(preference.title)
        editor.setAccessibleDescription(preference.words)
        return editor

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Ignores the wheel, so that scrolling does not change the control under the mouse pointer."""
        if event.type() == QEvent.Type.Wheel:
            event.ignore()
            return True
        return super().eventFilter(watched, event)

    def _take_choice(self, key: str, _: int) -> None:
        editor = self.editors[key]
        assert isinstance(editor, QComboBox)
        self._preferences.set(key, str(editor.currentData()))

    def _show(self, key: str) -> None:
        """Shows a value that was changed elsewhere."""
        editor, value = self.editors[key], self._preferences[key]
        with QSignalBlocker(editor):
            if isinstance(editor, QComboBox):
                editor.setCurrentIndex(editor.findData(value))
            elif isinstance(editor, QCheckBox):
                editor.setChecked(bool(value))
            else:
                editor.setValue(float(value))

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


class _KeyField(QKeySequenceEdit):
    """Takes all keys except Esc, which closes the dialog."""

    def event(self, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Escape:
            event.ignore()
            return False
        return super().event(event)


class KeyTable(TableModel[KeyRow]):
    """One row for each command, then the flight keys, then the fixed keys."""

    def __init__(self, bindings: KeyBindings, parent: QWidget) -> None:
        self._bindings = bindings
        self.conflicts = bindings.conflicts()
        """Id of a command -> the titles of the commands with the same keys."""

        def conflicting(row: KeyRow) -> str:
            return colors.text("blocked") if row.id in self.conflicts else faded(row)

        def faded(row: KeyRow) -> str:
            return "" if row.id else parent.palette().placeholderText().color().name()

        columns: tuple[Column[KeyRow], ...] = (
            Column("Command", lambda row: row.title, ink=faded),
            Column("Where", lambda row: row.place, ink=faded),
            Column("Keys", bindings.keys, ink=conflicting),
            Column("Default", self._default, ink=faded),
            Column("Conflicts", lambda row: self.conflicts.get(row.id, ()),
                   lambda others: f"⚠ {', '.join(others)}" if others else "", ink=conflicting),
        )  # fmt: skip
        super().__init__(columns, parent, about=self._about_conflict)
        self.refresh()

    def refresh(self) -> None:
        self.conflicts = self._bindings.conflicts()
        self.show(self._bindings.rows)

    def _default(self, row: KeyRow) -> str:
        return "cannot be changed" if not row.id else row.default if self._bindings.keys(row) != row.default else ""

    def _about_conflict(self, row: KeyRow) -> str:
        others = self.conflicts.get(row.id, ())
        also = f"Also the keys of: {', '.join(others)}. None of these commands runs until the keys differ."
        return also if others else ""


class _PreferenceFilter(QSortFilterProxyModel):
    """The rows that contain all words; with `only`, just the rows that have conflicts."""

    words: tuple[str, ...] = ()
    only = False

    def show_only(self, words: tuple[str, ...], only: bool) -> None:
        self.words, self.only = words, only
        self.invalidate()

    def filterAcceptsRow(self, source_row: int, source_parent: Index) -> bool:
        keys = self.sourceModel()
        assert isinstance(keys, KeyTable)
        if self.only and keys.row(source_row).id not in keys.conflicts:
            return False
        cells = " ".join(str(keys.data(keys.index(source_row, c))) for c in range(keys.columnCount())).casefold()
        return all(word in cells for word in self.words)


class KeyPage(QWidget):
    """The page of keys in the preferences. `search` applies the search text of the dialog."""

    def __init__(self, bindings: KeyBindings, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bindings = bindings
        self.table = KeyTable(bindings, self)
        self._fitting = _PreferenceFilter(self)
        self._fitting.setSourceModel(self.table)
        self.view = self._view()
        self.editor = named(_KeyField(self), "New keys", "Click here and press the new keys; they apply at once")
        self.editor.setMaximumSequenceLength(1)
        self.none = self._button("None", "Remove the keys of this command")
        self.reset = self._button("Reset", "Restore the default keys of this command")
        self.reset_all = self._button("Reset to defaults", "Restore the default keys of all commands")
        self.only = QCheckBox("Only conflicts", self)
        self.only.setToolTip("Show only commands that have the same keys as another one")
        self.words = Label(self, wordWrap=True)
        self.of = Label("Keys", self)
        row = WrappingRow(self.of, self.editor, self.none, self.reset, self.reset_all, self.only)
        vbox((self.view, 1), row, self.words, on=self)
        self.editor.editingFinished.connect(self._bind)
        self.none.clicked.connect(self._clear)
        self.reset.clicked.connect(self._reset)
        self.reset_all.clicked.connect(bindings.reset_all)
        self.only.toggled.connect(self._filter)
        self.view.selectionModel().currentRowChanged.connect(self._show)
        self.view.doubleClicked.connect(self.editor.setFocus)
        bindings.changed.connect(self._on_changed)
        self._typed = ""
        self._show_message("")
        self._show()

    def _view(self) -> QTableView:
        view = table(self._fitting, self, "Commands and their keys")
        header = view.horizontalHeader()
        header.setStretchLastSection(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        return view

    def _button(self, text: str, words: str) -> QPushButton:
        button = named(QPushButton(text, self), tip=words)
        button.setAutoDefault(False)
        return button

    @property
    def current(self) -> KeyRow | None:
        """The selected row."""
        index = self._fitting.mapToSource(self.view.currentIndex())
        return self.table.row(index.row()) if index.isValid() else None

    def choose(self, id: str) -> None:
        """Selects the row of a command. Raises StopIteration if there is none."""
        row = next(i for i, row in enumerate(self._bindings.rows) if row.id == id)
        self.view.setCurrentIndex(self._fitting.mapFromSource(self.table.index(row, 0)))

    def search(self, typed: str) -> int:
        """Shows the rows that contain all words of `typed`; returns their number."""
        self._typed = typed
        self._filter()
        return self._fitting.rowCount()

    def _filter(self, _: object = None) -> None:
        self._fitting.show_only(tuple(self._typed.casefold().split()), self.only.isChecked())

    def _bind(self) -> None:
        row, keys = self.current, self.editor.keySequence().toString()
        if row is not None and row.id and keys and keys != self._bindings.keys(row):
            self._show_message(self._bindings.bind(row.id, keys))
            self._show()

    def _clear(self) -> None:
        if (row := self.current) is not None and row.id:
            self._show_message(self._bindings.bind(row.id, ""))
            self._show()

    def _reset(self) -> None:
        if (row := self.current) is not None and row.id:
            self._bindings.reset(row.id)
            self._show()

    def _show(self, *_: object) -> None:
        row = self.current
        free = row is not None and bool(row.id)
        for widget in (self.editor, self.none, self.reset):
            widget.setEnabled(free)
        self.of.setText("Keys of the selected command:" if row is None else f"Keys of {plain(row.title)}:")
        keys = "" if row is None or not free else self._bindings.keys(row)
        if self.editor.keySequence().toString() != keys:
            self.editor.setKeySequence(QKeySequence(keys))

    def _on_changed(self) -> None:
        self.table.refresh()
        self._show_message("")
        self._show()
        self._filter()

    def _show_message(self, refusal: str) -> None:
        found = self.table.conflicts
        both = f"{len(found)} commands share their keys with another command; these keys run none of them."
        self.words.setText(refusal or (both if found else "There are no conflicts."))
