"""Fixed texts of every panel, in every workspace, in small windows: none is cut off."""

from __future__ import annotations

from pathlib import Path

import pytest
from cut_texts import cut_texts
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QTabBar
from pytestqt.qtbot import QtBot

from nvsim.graph.selection import GraphSelection
from nvsim.project.work import WORK
from nvsim_app.forms.fields import Settings
from nvsim_app.forms.form import CommandForm
from nvsim_app.state.document import Document
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WORKSPACE_LAYOUTS


@pytest.mark.parametrize("size", [(1272, 680), (952, 500)])
def test_no_fixed_text_is_cut(window: MainWindow, document: Document, qtbot: QtBot, size: tuple[int, int]) -> None:
    found = set[str]()
    window.resize(*size)
    ids, edges = document.graph_arrays.ids, sorted(document.contents.graph.edges)
    selections = (
        lambda: document.select(viewpoint=ids[0]),
        lambda: document.editing.select(GraphSelection(frozenset(), frozenset({edges[0]}))),
        lambda: document.editing.select(GraphSelection(frozenset(ids[:2]), frozenset())),
        lambda: document.select(frame=0),
        lambda: document.select(submap=0),
        lambda: document.select(),
    )
    for layout in WORKSPACE_LAYOUTS:
        window.actions_table[f"workspace_{layout.id}"].trigger()
        window.actions_table["reset_layout"].trigger()
        for name, dock in window.docks.items():
            if dock.isHidden():
                continue
            dock.raise_()
            for select in selections if name in ("details", "inspector") else selections[-1:]:
                select()
                for _ in range(20):  # until the layout is settled
                    qtbot.wait(20)
                    if not (cut := list(cut_texts(dock))):
                        break
                found |= {f"{layout.id}/{name}: {text}" for text in cut}
        for bar in window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly):
            found |= {f"{layout.id}: {text}" for text in cut_texts(bar)}
    assert not found, "\n".join(sorted(found))


@pytest.mark.parametrize("verb", sorted(WORK))
def test_no_option_of_a_form_is_cut(qtbot: QtBot, tmp_path: Path, verb: str) -> None:
    form = CommandForm(verb, WORK[verb].title, tmp_path, Settings(None))
    qtbot.addWidget(form)
    form.show()
    form.finish_building()
    qtbot.waitUntil(lambda: not list(cut_texts(form)), timeout=2000)
