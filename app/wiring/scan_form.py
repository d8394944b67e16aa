"""The form of a scan or dataset export, with an estimate beside its options.

The estimate runs the command itself, so that the form is disabled with the sentence of the command's refusal. It uses
the saved graph.
"""

from __future__ import annotations

from PySide6.QtCore import QObject

from app.forms.form import CommandForm
from app.panels.scan_estimate import ScanEstimatePanel
from app.wiring.part import WindowContext
from nvsim.graph.history import counted

_READ = frozenset({"graph", "submaps", "scene_stamp"})
"""Parts of the document that change the estimate."""


class ScanForm(QObject):
    """Adds the estimate to `form`, and exists as long as the form."""

    def __init__(self, form: CommandForm, context: WindowContext) -> None:
        super().__init__(form)
        self._form, self._context = form, context
        document = context.document
        assert document.project is not None  # the form exists only with a project
        self.panel = ScanEstimatePanel(document.project, form.verb, form)
        form.stand_beside(self.panel)
        form.tried.connect(self.panel.show_arguments)
        form.finished.connect(self.panel.question.stop)
        self.panel.refused.connect(self._on_refused)
        self.panel.saveWanted.connect(document.editing.save)
        self.panel.findingsWanted.connect(self._show_findings)
        document.editing.stepsChanged.connect(self._show_unsaved)
        document.contentsChanged.connect(self._on_contents)
        self._unsaved = False
        self._show_unsaved()

    def _show_unsaved(self) -> None:
        editing = self._context.document.editing
        before, self._unsaved = self._unsaved, editing.dirty
        words = ""
        if editing.history is not None and self._unsaved:
            count = editing.history.edits_since_saved()
            are = "is" if count == 1 else "are"
            words = f"{counted(count, 'edit')} of the graph {are} not saved; the scan is made from the saved graph."
        self.panel.show_unsaved(words, editing.writable)
        if before and not self._unsaved:
            self.panel.ask_again()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & _READ:
            self.panel.ask_again()

    def _on_refused(self, sentence: str) -> None:
        """Disables the form with the refusal, unless a running or queued job may resolve it."""
        waits = bool(sentence) and any(h.state in ("running", "queued") for h in self._context.jobs.handles)
        if waits:
            self.panel.title.setText("Not possible yet; the running jobs may change that.")
        self._form.hold("" if waits else sentence)
        self.panel.findings.setVisible("--force" in sentence)

    def _show_findings(self) -> None:
        self._form.reject()
        self._context.window.show_dock("validation")
