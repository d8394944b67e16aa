"""The page of networks lists the installed ones. A child process installs and tests them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from nvsim_app.panels.models import ModelsWindow
from nvsim_app.state.document import Document
from nvsim_app.wiring.panels import ModelsPart


@pytest.fixture
def page(make_window, document: Document, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "unit"))
    window = make_window(document)
    window.actions_table["models"].trigger()
    part = window.part(ModelsPart)
    assert part.page is not None
    qtbot.waitUntil(lambda: bool(part.models.found), timeout=30_000)
    yield part.page
    window.close()


def rows(page: ModelsWindow) -> dict[str, str]:
    """Name -> state."""
    return {g.child(i).text(0): g.child(i).text(1) for g in page._groups() for i in range(g.childCount())}


def choose(page: ModelsWindow, name: str) -> str:
    page._choose(name)
    return page.details.toPlainText()


def test_what_is_known_says_where_it_comes_from_and_cannot_be_tried(page: ModelsWindow, tmp_path: Path) -> None:
    assert str(tmp_path / "models") in page.folder.text()
    assert rows(page)["moge-2"] == "not installed" and rows(page)["bundled-floor"] == "installed"
    words = choose(page, "segformer-ade20k")
    assert "research and evaluation only" in words and "huggingface.co" in words and "Would improve" in words
    assert not page.check_button.isEnabled() and "Select an installed network" in page.check_button.toolTip()


def test_a_network_is_installed_from_its_files_and_tried(
    page: ModelsWindow, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from normal_networks import metric3d

    path = metric3d(tmp_path / "metric3d-vit-small.onnx", np.zeros((3, 3)), (0.0, -0.7, -0.7))
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_: ([str(path)], ""))
    page.add_button.click()
    assert not page.add_button.isEnabled() and "copying" in page.state.text()
    qtbot.waitUntil(lambda: "metric3d-vit-small" in rows(page), timeout=30_000)
    assert rows(page)["metric3d-vit-small"] == "installed" and "moge-2" not in rows(page)
    assert "BSD-2-Clause" in page.details.toPlainText(), "what was installed is chosen"
    page.check_button.click()
    qtbot.waitUntil(lambda: rows(page)["metric3d-vit-small"] == "works", timeout=30_000)
    assert "ms per image" in page.details.toPlainText()
    (tmp_path / "models" / "metric3d-vit-small" / path.name).write_bytes(b"broken")
    page.check_button.click()
    qtbot.waitUntil(lambda: rows(page)["metric3d-vit-small"] == "does not work", timeout=30_000)
    assert "is not the file that was described" in page.details.toPlainText()


def test_files_that_fit_nothing_are_refused_with_the_sentence_of_the_command(
    page: ModelsWindow, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "<b>strange.onnx"
    path.write_bytes(b"no network")
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_: ([str(path)], ""))
    page.add_button.click()
    qtbot.waitUntil(lambda: "cannot be loaded" in page.state.text(), timeout=30_000)
    assert "<b>strange.onnx" in page.state.text() and page.add_button.isEnabled()
    assert not (tmp_path / "models" / "strange").exists()
