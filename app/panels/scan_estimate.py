"""A panel beside the options of a scan or dataset export: the files to write, the disk space, and the time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QFrame, QGridLayout, QPushButton, QVBoxLayout, QWidget

from app.jobs.scan_estimate import ScanEstimate, ScanQuestion
from app.look.labels import InkLabel, Label
from app.look.metrics import type_font
from nvsim.graph.history import counted
from nvsim.r2r.observations.estimate import size_words

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
        self.save = QPushButton("Save the graph", self)
        self.save.setAutoDefault(False)
        self.save.clicked.connect(self.saveWanted)
        self.title = self._words()
        self.title.setFont(type_font(bold=True))
        self.rows = QWidget(self)
        self._grid = QGridLayout(self.rows)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setColumnStretch(0, 1)
        self.room, self.there = self._words(), self._words()
        self.shortage = self._words("warning")
        self.findings = QPushButton("Show the findings", self)
        self.findings.setAutoDefault(False)
        self.findings.setToolTip("Close this form and show the problems of the graph")
        self.findings.clicked.connect(self.findingsWanted)
        column = QVBoxLayout(self)
        for widget in (self.unsaved, self.save, self.title, self.rows, self.room, self.there, self.shortage):
            column.addWidget(widget)
        column.addWidget(self.findings)
        column.addStretch(1)
        self.show_unsaved("", False)
        self.findings.hide()
        self.estimate: ScanEstimate | None = None
        self._wait()

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
            self._wait()
            self.question.start(self._project, self._arguments)

    def _wait(self) -> None:
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
            f"Scan {found.scans[0]}" if len(found.scans) == 1 else f"{len(found.scans)} scans, {_ends(found.scans)}"
        )
        self.room.setText(f"Takes {found.time}.\nFree disk space there: {size_words(found.free)}.")
        there = found.drawn - found.todo
        self.there.setText(
            f"{there} of {counted(found.drawn, 'viewpoint')} {'is' if there == 1 else 'are'} already there, with the "
            "same settings."
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


def _ends(names: Sequence[str]) -> str:
    return f"{names[0]} to {names[-1]}"
