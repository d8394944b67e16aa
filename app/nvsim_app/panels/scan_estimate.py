"""Panels beside the options of exports: the files of a scan or a dataset with their size and time, and the layouts and
networks of features."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, QSize, Qt, Signal
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QFrame, QGridLayout, QVBoxLayout, QWidget

from nvsim.files.records import record_of
from nvsim.networks.folder import models_folder
from nvsim.plain_text import count_text
from nvsim.r2r.features.layouts import LAYOUTS, Layout, feature_maker, missing_package_error, network_name
from nvsim.r2r.observations.estimate import size_words
from nvsim_app.jobs.queries import CommandQuery
from nvsim_app.look.boxes import STRETCH, vbox
from nvsim_app.look.labels import InkLabel, Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import push_button

VERB, DATASET = "export scan", "export dataset"


@dataclass(frozen=True)
class Kind:
    """Files of one kind: description, number of files, total bytes."""

    what: str
    files: int
    bytes: int


@dataclass(frozen=True)
class ScanEstimate:
    """The estimate of an export.

    scans     ids of the scans to write
    kinds     the kinds of files
    files     total number of files
    bytes     total size of the files
    drawn     number of viewpoints with images
    todo      number of these viewpoints whose images are missing
    time      the expected duration as text
    free      free bytes on the target disk
    shortage  one sentence if the free space is too small, else ""
    """

    scans: tuple[str, ...]
    kinds: tuple[Kind, ...]
    files: int
    bytes: int
    drawn: int
    todo: int
    time: str
    free: int
    shortage: str


def estimate_of(text: str) -> ScanEstimate:
    """Parses the output of `--dry-run --json`. Raises ValueError if it is not an estimate."""
    try:
        return record_of(ScanEstimate, json.loads(text))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not an estimate: {text[:80]!r}") from error


class ScanQuestion(CommandQuery):
    """Requests an estimate. Emits finished(ScanEstimate), or failed(str) with the reason why the export is impossible.
    Only the last `start` gets an answer."""

    def __init__(self, verb: str = VERB, parent: QObject | None = None) -> None:
        super().__init__(estimate_of, "The estimate", parent)
        self._verb = verb

    def start(self, project: Path, arguments: Sequence[str]) -> None:
        """Requests the estimate of the command with these arguments."""
        self.ask([*self._verb.split(), "--project", str(project), *arguments, "--dry-run", "--json"])


WIDTH = 300  # pixels


class ScanEstimatePanel(QFrame):
    """The estimate of an export.

    refused(str): the reason why the export is impossible; "" if it is possible. saveWanted(): save the graph.
    findingsWanted(): show the findings about the graph.
    """

    refused = Signal(str)
    saveWanted = Signal()
    findingsWanted = Signal()

    def __init__(self, project: Path, verb: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._project = project
        self._arguments: list[str] | None = None
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.setFixedWidth(WIDTH)
        self.question = ScanQuestion(verb, self)
        self.question.finished.connect(self.show_estimate)
        self.question.failed.connect(self._on_failed)
        self.unsaved = self._words("warning")
        self.save = push_button("Save the graph", self, self.saveWanted, autoDefault=False)
        self.title = self._words()
        self.title.setFont(type_font(bold=True))
        self.rows = QWidget(self)
        self._grid = QGridLayout(self.rows)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setColumnStretch(0, 1)
        self.room, self.there = self._words(), self._words()
        self.shortage = self._words("warning")
        tip = "Close this form and show the problems of the graph"
        self.findings = push_button("Show the findings", self, self.findingsWanted, tip, autoDefault=False)
        above = (self.unsaved, self.save, self.title, self.rows)
        vbox(*above, self.room, self.there, self.shortage, self.findings, STRETCH, on=self)
        self.show_unsaved("", False)
        self.findings.hide()
        self.estimate: ScanEstimate | None = None
        self._gray_out()

    def _words(self, ink: str = "") -> Label:
        label = InkLabel(ink, self)
        label.setWordWrap(True)
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        return label

    def sizeHint(self) -> QSize:
        return QSize(WIDTH, super().sizeHint().height())

    # Requests -----------------------------------------------------------------------------------------------------

    def show_arguments(self, arguments: Sequence[str]) -> None:
        """Requests a new estimate if the arguments changed."""
        if list(arguments) != self._arguments:
            self._arguments = list(arguments)
            self.ask_again()

    def ask_again(self) -> None:
        """Requests a new estimate after a change outside the options."""
        if self._arguments is not None:
            self._gray_out()
            self.question.start(self._project, self._arguments)

    def _gray_out(self) -> None:
        """Grays out the previous estimate until the new one arrives."""
        for widget in (self.rows, self.room, self.there):
            widget.setEnabled(False)
        if self.estimate is None:
            self.title.setText("Estimating the export…")

    # Answers ----------------------------------------------------------------------------------------------------

    def show_unsaved(self, words: str, can_be_saved: bool) -> None:
        """Shows a message about unsaved edits; "" hides it."""
        self.unsaved.setText(words)
        self.unsaved.setVisible(bool(words))
        self.save.setVisible(bool(words) and can_be_saved)

    def show_estimate(self, found: ScanEstimate) -> None:
        self.estimate = found
        self._fill(found)
        self.title.setText(
            f"Scan {found.scans[0]}"
            if len(found.scans) == 1
            else f"{len(found.scans)} scans, {_first_and_last(found.scans)}"
        )
        self.room.setText(f"Takes {found.time}.\nFree disk space there: {size_words(found.free)}.")
        there = found.drawn - found.todo
        self.there.setText(
            f"{there} of {count_text(found.drawn, 'viewpoint')} {'is' if there == 1 else 'are'} already there, "
            "with the same settings."
        )
        self.there.setVisible(there > 0)
        self.shortage.setText(found.shortage)
        self.shortage.setVisible(bool(found.shortage))
        self.findings.hide()
        self.refused.emit("")

    def _on_failed(self, sentence: str) -> None:
        self.estimate = None
        self.title.setText("This export is not possible.")
        for widget in (self.rows, self.room, self.there, self.shortage):
            widget.hide()
        self.refused.emit(sentence)

    def _fill(self, found: ScanEstimate) -> None:
        while (item := self._grid.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.deleteLater()
        rows = [("", "files", "approx. size"), *((k.what, f"{k.files:,}", size_words(k.bytes)) for k in found.kinds)]
        rows.append(("total", f"{found.files:,}", size_words(found.bytes)))
        for i, (what, files, size) in enumerate(rows):
            for column, words in enumerate((what, files, size)):
                label = Label(words, self.rows)
                if column:
                    label.setAlignment(Qt.AlignmentFlag.AlignRight)
                if i == 0:
                    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
                if i == len(rows) - 1:
                    label.setFont(self.title.font())
                self._grid.addWidget(label, i, column)
        for widget in (self.rows, self.room, self.there):
            widget.setEnabled(True)
        self.rows.show()
        self.room.show()


def _first_and_last(names: Sequence[str]) -> str:
    return f"{names[0]} to {names[-1]}"


_WIDE = 330  # pixels


class FeatureMakersPanel(QFrame):
    """Lists the layouts of features. `makers` holds a label for each layout, with the network that computes it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, frameShape=QFrame.Shape.StyledPanel)
        self.setFixedWidth(_WIDE)
        column = QVBoxLayout(self)
        column.setSpacing(4)
        self._names: dict[str, Label] = {}
        self.makers: dict[str, InkLabel] = {}
        for layout in LAYOUTS.values():
            self._names[layout.name] = self._words()
            self.makers[layout.name] = self._words()
            self._names[layout.name].setText(f"{layout.name}: {layout.readers}")
            self._names[layout.name].setToolTip(tooltip_text(f"{layout.file}, {_numbers(layout)}"))
            for label in (self._names[layout.name], self.makers[layout.name]):
                column.addWidget(label)
            column.addSpacing(6)
        self.folder = self._words()
        self.folder.setText(
            f"To use another network for a layout, put it with its description into {models_folder()}, for example "
            f"{network_name(LAYOUTS['clip-b16'])}.onnx and .toml."
        )
        column.addWidget(self.folder)
        column.addStretch(1)
        self.show_makers((), None, False)

    def show_makers(self, chosen: Sequence[str], model: Path | None, projection: bool) -> None:
        """Shows what computes each layout. The `chosen` layouts are bold."""
        for layout in LAYOUTS.values():
            name, words = self._names[layout.name], self.makers[layout.name]
            name.setFont(type_font(bold=layout.name in chosen))
            missing = missing_package_error(layout)
            words.setText(missing or f"by {feature_maker(layout, model, projection).words}")
            words.set_ink("warning" if missing else "")

    def _words(self) -> InkLabel:
        label = InkLabel("", self)
        label.setWordWrap(True)
        return label


def _numbers(layout: Layout) -> str:
    return (
        f"{layout.tokens} x {layout.width} numbers per candidate"
        if layout.tokens
        else f"{layout.width} numbers per view"
    )
