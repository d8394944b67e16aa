"""Number fields: typed values are committed on Enter or when the focus leaves, with a point or a comma."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QLineEdit, QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

import nvsim_app
from nvsim_app.look.widgets import NumberBox
from nvsim_app.wiring.thresholds import ThresholdPart
from nvsim_app.wiring.window import MainWindow


def type_into(qtbot: QtBot, box: NumberBox, text: str) -> None:
    box.setFocus()
    box.selectAll()
    qtbot.keyClicks(box, text)


@pytest.mark.parametrize("text", ["0.97", "0,97"])
def test_a_threshold_can_be_typed(window: MainWindow, qtbot: QtBot, text: str) -> None:
    part = window.part(ThresholdPart)
    window.actions_table["workspace_edit"].trigger()
    window.show_dock("thresholds")
    row = part.panel.rows["tau_alpha"]
    before, tried = part.trial.config.tau_alpha, []
    part.trial.changed.connect(lambda: tried.append(part.trial.config.tau_alpha))
    type_into(qtbot, row.figure, text)
    assert row.figure.text() == "0.97"
    assert not tried and part.trial.config.tau_alpha == before != 0.97  # not while it is typed
    qtbot.keyClick(row.figure, Qt.Key.Key_Return)
    assert tried == [0.97] and row.figure.text() == "0.97"
    assert row.slider.value() == row.threshold.to_step(0.97)


def test_a_number_is_committed_when_the_focus_leaves(qtbot: QtBot) -> None:
    holder = QWidget()
    qtbot.addWidget(holder)
    layout = QVBoxLayout(holder)
    box, line, seen = NumberBox("Length", 0, 10, 1, suffix=" m"), QLineEdit(), list[float]()
    layout.addWidget(box)
    layout.addWidget(line)
    box.valueChanged.connect(seen.append)
    holder.show()
    holder.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is holder, timeout=5000)
    type_into(qtbot, box, "1,4")
    assert seen == []
    qtbot.keyClick(box, Qt.Key.Key_Tab)
    assert seen == [1.4] and box.text() == "1.40 m" and line.hasFocus()
    qtbot.keyClick(box, Qt.Key.Key_Up)
    assert seen == [1.4, 2.4]
    type_into(qtbot, box, "seven")
    qtbot.keyClick(box, Qt.Key.Key_Return)
    assert seen == [1.4, 2.4] and box.value() == 2.4


def test_all_number_fields_are_of_this_class() -> None:
    folder = Path(nvsim_app.__file__).parent
    files = [path for path in folder.rglob("*.py") if re.search("Q(Double)?SpinBox", path.read_text())]
    assert [path.name for path in files] == ["widgets.py"]
