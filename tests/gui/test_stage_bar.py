"""The bar that offers the next stage."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from nvsim_app.panels.stages import StageBar


@pytest.mark.parametrize("width", [1000, 560, 320, 240])
def test_no_button_of_the_bar_is_cut(qtbot: QtBot, width: int) -> None:
    parent = QWidget()
    qtbot.addWidget(parent)
    parent.resize(width, 500)
    bar = StageBar(parent)
    parent.show()
    bar.show_message("The submaps have no model yet. Training takes about 20 minutes on this machine.", "train")
    qtbot.waitUntil(bar.isVisible)
    assert parent.rect().contains(bar.geometry())
    for button in (bar.everything, bar.stage, bar.settings):
        assert bar.rect().contains(button.geometry())
        assert button.width() >= button.sizeHint().width()
    needed = bar.sentence.heightForWidth(bar.sentence.width()) if bar.sentence.wordWrap() else 0
    assert bar.sentence.height() >= needed
