"""The status bar, and the buttons of dialogs."""

from __future__ import annotations

from PySide6.QtWidgets import QDialog, QDialogButtonBox, QVBoxLayout
from pytestqt.qtbot import QtBot

from nvsim_app.look.labels import Label
from nvsim_app.look.widgets import DialogButtons, StatusLine


def test_a_long_message_ends_before_the_permanent_text(qtbot: QtBot) -> None:
    bar = StatusLine()
    qtbot.addWidget(bar)
    summary = Label("439 frames")
    bar.addPermanentWidget(summary)
    bar.resize(400, 24)
    bar.show()
    empty = bar.grab().toImage()
    long = "Click selects · drag the selection to move it · arrow keys nudge it · Ctrl+drag selects a box · right click"
    bar.showMessage(long)
    shown = bar.grab().toImage()
    assert bar.toolTip() and shown != empty
    changed = [x for x in range(400) for y in range(24) if shown.pixel(x, y) != empty.pixel(x, y)]
    assert max(changed) < summary.x() - 4
    bar.showMessage("Click selects · drag the selection to move it")
    assert bar.grab().toImage() == shown, "only whole clauses are shown"


def test_cancel_has_no_icon_and_ends_the_row(qtbot: QtBot) -> None:
    dialog = QDialog()
    qtbot.addWidget(dialog)
    buttons = DialogButtons(dialog)
    QVBoxLayout(dialog).addWidget(buttons)
    start = buttons.addButton("Start", QDialogButtonBox.ButtonRole.AcceptRole)
    keep = buttons.addButton("Save settings", QDialogButtonBox.ButtonRole.ActionRole)
    cancel = buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
    dialog.show()
    assert all(button.icon().isNull() for button in (start, keep, cancel))
    assert not start.x() < cancel.x() < keep.x()
