"""The first changes of CONTRIBUTING.md that a user sees: a panel, and an operation in the menu, each with a toy."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from PySide6.QtWidgets import QLabel

from nvsim.graph import operation_table
from nvsim.graph.arguments import Argument
from nvsim.graph.edits import set_height
from nvsim.graph.offers import MenuEntry, SelectionNeeds
from nvsim_app.state.document import Document
from nvsim_app.wiring import window as window_module
from nvsim_app.wiring.part import Dock, Part
from nvsim_app.wiring.window import MainWindow


class CountPanel(QLabel):
    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        document.graphChanged.connect(lambda _: self._count())
        self._count()

    def _count(self) -> None:
        self.setText(f"{len(self._document.graph_arrays.ids)} viewpoints")


class CountPart(Part):
    def docks(self) -> tuple[Dock, ...]:
        return (Dock("count", "Count", CountPanel(self.context.document), "left", workspaces=("explore", "edit")),)


def test_a_panel_is_a_widget_and_a_part(
    document: Document, make_window: Callable[[Document], MainWindow], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window_module, "PARTS", (CountPart, *window_module.PARTS))
    window = make_window(document)
    count, panel = len(document.graph_arrays.ids), window.panels["count"]
    assert isinstance(panel, CountPanel) and panel.isVisible() and panel.text() == f"{count} viewpoints"
    assert "Count" in [action.text() for action in window.findChildren(type(window.actions_table["save"]))]
    document.editing.run("remove_viewpoints", {"ids": [document.graph_arrays.ids[0]]})
    assert panel.text() == f"{count - 1} viewpoints"
    window.actions_table["workspace_train"].trigger()
    assert not panel.isVisible()
    window.actions_table["workspace_edit"].trigger()
    assert not window.docks["count"].isHidden()


def test_an_operation_with_a_menu_entry_is_in_the_menu(
    document: Document, make_window: Callable[[Document], MainWindow], monkeypatch: pytest.MonkeyPatch
) -> None:
    row = operation_table.Operation(
        "kneel",
        "Lower cameras to half a metre",
        lambda graph, surroundings, ids: set_height(graph, ids, 0.5),
        (Argument("ids", "viewpoints", "ids of viewpoints"),),
        lambda a: "Kneel",
        (
            MenuEntry(
                "kneel", "&Kneel", "Lower the cameras to half a metre", 3, SelectionNeeds("viewpoints"), "Ctrl+Alt+K"
            ),
        ),
    )
    monkeypatch.setitem(operation_table.OPERATIONS, "kneel", row)
    window = make_window(document)
    action = window.actions_table["kneel"]
    assert not action.isEnabled() and "elect" in action.toolTip()
    id = document.graph_arrays.ids[0]
    document.select(viewpoint=id)
    action.trigger()
    assert document.graph is not None and document.graph.viewpoints[id].height == 0.5
    assert window.actions_table["undo"].text() == "&Undo kneel"
    window.actions_table["undo"].trigger()
    assert document.graph.viewpoints[id].height == 1.5
