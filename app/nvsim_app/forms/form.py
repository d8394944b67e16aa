"""The settings form of one command: every option with its default and its paper value, and the resulting command."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QFontDatabase, QGuiApplication
from PySide6.QtWidgets import QComboBox, QDialogButtonBox, QFrame, QHBoxLayout, QLineEdit, QListWidget, QWidget

from nvsim.cli.options import command_of
from nvsim.errors import InputError
from nvsim.plain_text import capitalized
from nvsim_app.forms.fields import (
    Field,
    Settings,
    arguments_of,
    command_line,
    fields_of,
    paper_values,
    presets_of,
    validate,
)
from nvsim_app.forms.rows import OptionRow
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.labels import InkLabel, Label
from nvsim_app.look.plain_text import SENTENCE, plain
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import Dialog, DialogButtons, Scrolling, named, push_button

GENERAL = "General"
TYPING = 250  # milliseconds after the last key press until the values are validated


class CommandForm(Dialog):
    """A dialog that edits the options of one command.

    started(list of arguments)   the user started the command; the settings are already stored
    tried(list of arguments)     the options were validated and are correct

    preset_values   path -> initial value of options that the user has not changed
    """

    started = Signal(object)
    tried = Signal(object)

    def __init__(
        self,
        verb: str,
        title: str,
        project: Path,
        settings: Settings,
        parent: QWidget | None = None,
        preset_values: dict[str, Any] | None = None,
        start_text: str = "Start",
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle(title)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.verb, self._project, self._settings = verb, project, settings
        self._begin_with = {**(preset_values or {}), **settings.changed(verb)}
        self._paper = paper_values(verb)
        self.rows: dict[str, OptionRow] = {}
        self._headings: dict[str, Label] = {}
        self._wrong = self._held = ""  # the error in the options; another reason not to start
        self._build(title, start_text)
        self._waiting = self._sections()
        self._try = QTimer(self, singleShot=True, interval=TYPING)
        self._try.timeout.connect(self._show_command)
        # The form is built section by section between other events, because training has eighty options.
        self._more = QTimer(self, interval=0)
        self._more.timeout.connect(self._build_section)
        self._more.start()
        few = len(self._waiting) == 1
        self.resize(640 if few else 860, 360 if sum(len(s) for s in self._waiting.values()) < 4 else 640)

    # Building --------------------------------------------------------------------------------------------------

    def _build(self, title: str, start_text: str) -> None:
        about = (command_of(self.verb).__doc__ or "").split("\n\n")[0]
        intro = Label(" ".join(about.split()), self, wordWrap=True)
        self.replaces = Label(self._replaced(), self, wordWrap=True)
        self.replaces.setVisible(bool(self.replaces.text()))
        self.presets = named(QComboBox(self), "Preset")
        self.presets.addItems(presets_of(self.verb))
        self.presets.setCurrentText(self._settings.preset(self.verb))
        self.presets.currentTextChanged.connect(self._on_preset)
        self.search = QLineEdit(self, placeholderText="Find a setting", clearButtonEnabled=True)
        self.search.setAccessibleName("Find an option")
        self.search.textChanged.connect(self._filter)
        self.presets.setVisible(self.presets.count() > 0)
        above = QHBoxLayout()
        if self.presets.count():
            above.addWidget(Label("Preset", self))
            above.addWidget(self.presets)
            above.addSpacing(12)
        above.addWidget(self.search, 1)
        self.list = named(QListWidget(self), "Groups of options")
        self.list.setFixedWidth(150)
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setSpacing(4)
        self.list.currentTextChanged.connect(self._go_to_section)
        self._page = QWidget(self)
        self._column = vbox(STRETCH, on=self._page, margins=8)
        self.area = named(Scrolling(self._page, self), "Options")
        self.area.setFrameShape(QFrame.Shape.StyledPanel)
        self.area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._middle = hbox(self.list, (self.area, 1))
        self.problem = InkLabel("blocked", self)
        self.problem.setWordWrap(True)
        self.problem.hide()
        self._command_line = ""
        self.command = named(QLineEdit(self, readOnly=True), "Command", "The command for a terminal")
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        copy = push_button(
            "Copy", self, lambda: QGuiApplication.clipboard().setText(self._command_line), autoDefault=False
        )
        line = hbox((self.command, 1), copy)
        buttons = DialogButtons(self)
        self.start_button = buttons.addButton(start_text, QDialogButtonBox.ButtonRole.AcceptRole)
        self.keep_button = buttons.addButton("Save settings", QDialogButtonBox.ButtonRole.ActionRole)
        self.reset_button = buttons.addButton("Reset to defaults", QDialogButtonBox.ButtonRole.ResetRole)
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.keep_button.clicked.connect(self._keep_and_close)
        self.reset_button.clicked.connect(self.reset)
        buttons.accepted.connect(self._start)
        buttons.rejected.connect(self.reject)
        vbox(intro, self.replaces, above, (self._middle, 1), self.problem, line, buttons, on=self)

    def _replaced(self) -> str:
        """The sentence of the command about the results that it replaces; "" if it replaces none."""
        from nvsim.project.earlier_results import replaced_result_sentence
        from nvsim.project.project import Project
        from nvsim.project.work import STAGES

        if self.verb not in STAGES:
            return ""
        try:
            with Project.open(self._project) as project:
                sentence = replaced_result_sentence(project, self.verb)
        except InputError:  # the command reports the error when it starts
            return ""
        return capitalized(sentence)

    def _sections(self) -> dict[str, list[Field]]:
        result: dict[str, list[Field]] = {}
        for field in fields_of(self.verb, self.presets.currentText()):
            result.setdefault(field.section or GENERAL, []).append(field)
        self.list.setVisible(len(result) > 1)
        self.search.setVisible(sum(len(f) for f in result.values()) > 8)
        return result

    def _build_section(self) -> None:
        if not self._waiting:
            self._more.stop()
            self._filter(self.search.text())
            self._show_command()
            return
        title = next(iter(self._waiting))
        fields = self._waiting.pop(title)
        if self.list.isVisibleTo(self):
            heading = Label(title, self._page, font=type_font(bold=True))
            heading.setContentsMargins(0, 8, 0, 4)
            self._headings[title] = heading
            self._column.insertWidget(self._column.count() - 1, heading)
            self.list.addItem(title)
        for field in fields:
            paper = {"paper": self._paper[field.path]} if field.path in self._paper else {}
            row = OptionRow(field, parent=self._page, **paper)
            if field.path in self._begin_with:
                row.show_value(self._begin_with[field.path])
            row.changed.connect(self._try.start)
            self.rows[field.path] = row
            self._column.insertWidget(self._column.count() - 1, row)

    def finish_building(self) -> None:
        """Builds all remaining sections immediately."""
        while self._more.isActive():
            self._build_section()

    def show_beside(self, widget: QWidget) -> None:
        """Shows `widget` to the right of the options and widens the dialog by its size hint."""
        self._middle.addWidget(widget)
        self.resize(self.width() + widget.sizeHint().width() + 40, self.height())
        self.fit_screen()

    def block_start(self, sentence: str) -> None:
        """Shows why the command cannot start although its options are valid, and disables Start; "" enables it.
        Flags in the sentence are replaced by the names of the options."""
        for row in self.rows.values():
            sentence = re.sub(rf"{re.escape(row.field.flag)}(?![\w-]|\.\w)", f"“{row.field.name}”", sentence)
        self._held = sentence
        self._show_problem()

    # Values -----------------------------------------------------------------------------------------------------

    def changed(self) -> dict[str, Any]:
        """Path -> value of the options that differ from the preset. Raises ValueError with a sentence if a value is not
        valid."""
        return {path: row.editor.value() for path, row in self.rows.items() if row.is_changed}

    def arguments(self) -> list[str]:
        """The flags of the command. Raises ValueError if a value is not valid."""
        names = presets_of(self.verb)
        preset = self.presets.currentText()
        head = ["--preset", preset] if names and preset != names[0] else []
        return [*head, *arguments_of([row.field for row in self.rows.values()], self.changed())]

    def reset(self) -> None:
        """Resets every option to the first preset."""
        if self.presets.count():
            self.presets.setCurrentIndex(0)
        for row in self.rows.values():
            row.reset()
        self._show_command()

    def _on_preset(self, preset: str) -> None:
        for field in fields_of(self.verb, preset):
            if field.path in self.rows:
                self.rows[field.path].show_field(field)
        self._show_command()

    def _show_command(self) -> None:
        problem, arguments = "", []
        try:
            arguments = self.arguments()
            problem = validate(self.verb, self._project, arguments)
        except ValueError as error:
            problem = str(error)
        if not problem:
            self._command_line = command_line(self.verb, ["--project", str(self._project), *arguments])
            self.command.setText(plain(self._command_line, SENTENCE))
            self.command.setCursorPosition(0)
        self._wrong = problem
        self._show_problem()
        if not problem:
            self.tried.emit(arguments)

    def _show_problem(self) -> None:
        problem = self._wrong or self._held
        self.problem.setText(problem)
        self.problem.setVisible(bool(problem))
        self.keep_button.setEnabled(not self._wrong)
        self.start_button.setEnabled(not problem)

    def _filter(self, words: str) -> None:
        seen: set[str] = set()
        for row in self.rows.values():
            wanted = row.matches(words)
            row.setVisible(wanted)
            if wanted:
                seen.add(row.field.section or GENERAL)
        for title, heading in self._headings.items():
            heading.setVisible(title in seen)

    def _go_to_section(self, title: str) -> None:
        heading = self._headings.get(title)
        if heading is not None:
            self.search.clear()
            self.area.verticalScrollBar().setValue(heading.y() - 4)

    # Closing ----------------------------------------------------------------------------------------------------

    def _keep(self) -> Sequence[str] | None:
        self.finish_building()
        self._show_command()
        if not self.keep_button.isEnabled():
            return None
        self._settings.keep(self.verb, self.presets.currentText(), self.changed())
        return self.arguments()

    def _keep_and_close(self) -> None:
        if self._keep() is not None:
            self.reject()

    def _start(self) -> None:
        arguments = self._keep()
        if arguments is not None and not self._held:
            self.started.emit(list(arguments))
            self.accept()
