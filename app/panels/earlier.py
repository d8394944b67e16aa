"""The earlier results in a project, one for each stage, to restore or to delete."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QListWidget, QListWidgetItem, QVBoxLayout, QWidget

from app.look.dialog_buttons import DialogButtons
from app.look.labels import Label
from nvsim.project.earlier_results import Kept, megabytes


class EarlierResults(QDialog):
    """Lists the earlier results.

    chosen(stage: str, discard: bool): restore the earlier result of a stage, or delete it if `discard` is true.
    """

    chosen = Signal(str, bool)

    def __init__(self, kept: Sequence[Kept], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Earlier results")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        intro = Label(
            "Each row is the result of a stage before its last run. Restore exchanges it with the current result; "
            "later stages do not change.",
            self,
        )
        intro.setWordWrap(True)
        self.list = QListWidget(self)
        self.list.setAccessibleName("Earlier results")
        for one in kept:
            item = QListWidgetItem(f"{one.stage}: {one.words}, {megabytes(one.bytes)}", self.list)
            item.setData(Qt.ItemDataRole.UserRole, one.stage)
        self.list.setCurrentRow(0)
        self.list.itemDoubleClicked.connect(lambda _: self._choose(False))
        buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        self.restore_button = buttons.addButton("Restore", QDialogButtonBox.ButtonRole.AcceptRole)
        self.discard_button = buttons.addButton("Delete", QDialogButtonBox.ButtonRole.DestructiveRole)
        self.discard_button.setToolTip("Frees disk space; the current result stays")
        self.restore_button.clicked.connect(lambda: self._choose(False))
        self.discard_button.clicked.connect(lambda: self._choose(True))
        buttons.rejected.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.addWidget(intro)
        layout.addWidget(self.list)
        layout.addWidget(buttons)
        self.resize(620, 260)

    def _choose(self, discard: bool) -> None:
        item = self.list.currentItem()
        if item is not None:
            self.chosen.emit(item.data(Qt.ItemDataRole.UserRole), discard)
            self.accept()
