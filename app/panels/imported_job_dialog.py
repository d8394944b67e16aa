"""The dialog of a job that came with a project. The user sees its command, and then orders it here or removes it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QPlainTextEdit, QPushButton, QVBoxLayout, QWidget

from app.forms.arguments import command_line
from app.jobs.queue import JobQueue
from app.look.dialog_buttons import DialogButtons
from app.look.labels import InkLabel, Label
from app.look.plain_text import tip
from nvsim.errors import InputError
from nvsim.project.jobs.joblist import Job

_MOST = 20_000  # characters of a command that are shown


class ImportedJobDialog(QDialog):
    """Shows the stored order of a job. Exactly this order can be added to the queue."""

    def __init__(self, queue: JobQueue, job: Job, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("A job that was ordered elsewhere")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._queue, self._job = queue, job
        about = self._label(
            "This job came with the project and was not ordered on this machine. If you order it here, it runs:"
        )
        command = command_line(job.order.verb, job.order.arguments)
        self.command = QPlainTextEdit(command[:_MOST], self)
        self.command.setAccessibleName("Command")
        self.command.setReadOnly(True)
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        reason = queue.why_not_anew(job)
        if len(command) > _MOST:
            reason = "Its command is too long to be shown."
        self.problem = InkLabel("blocked", self)
        self.problem.setWordWrap(True)
        self.problem.setText(reason)
        self.problem.setVisible(bool(reason))
        buttons = DialogButtons(self)
        self.order = QPushButton("Order here", self)
        self.order.setAutoDefault(False)
        self.order.setEnabled(not reason)
        self.order.setToolTip(tip(reason or "Add the job to the queue as your own"))
        self.remove = QPushButton("Remove", self)
        self.remove.setAutoDefault(False)
        buttons.addButton(self.order, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.addButton(self.remove, QDialogButtonBox.ButtonRole.DestructiveRole)
        buttons.addButton(QDialogButtonBox.StandardButton.Close).setDefault(True)
        self.order.clicked.connect(self._on_order)
        self.remove.clicked.connect(self._on_remove)
        buttons.rejected.connect(self.reject)
        column = QVBoxLayout(self)
        for widget in (about, self.command, self.problem, buttons):
            column.addWidget(widget)
        self.resize(620, 260)

    def _label(self, text: str) -> Label:
        label = Label(text, self)
        label.setWordWrap(True)
        return label

    def _on_order(self) -> None:
        try:
            self._queue.order_anew(self._job)
        except InputError as error:
            self.problem.setText(str(error))
            self.problem.show()
            self.order.setEnabled(False)
            return
        self.accept()

    def _on_remove(self) -> None:
        handle = self._queue.handle(self._job.number)
        if handle is not None:
            self._queue.forget(handle)
        self.accept()
