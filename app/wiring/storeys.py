"""Going from storey to storey: a choice over the map, and commands for the keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QComboBox

from app.actions import Action
from app.look import lengths
from app.state.document import Document
from app.state.reasons import Reason, with_graph
from app.wiring.panels import MapPart
from app.wiring.part import Part, Workspace

_EDGE = 8  # pixels from the corner of the map


def with_storeys(document: Document) -> Reason:
    return with_graph(document) or (None if len(document.storeys.found) > 1 else "all viewpoints stand on one floor")


class StoreyPart(Part):
    """What is not shown is not clicked, drawn around or selected by Select all."""

    ACTIONS = (
        Action("storey_up", "Storey &above", "Show the next higher floor of the graph alone, in the map and in 3D",
               "&View", 5, "Alt+PgUp", enabled=with_storeys),
        Action("storey_down", "Storey &below", "Show the next lower floor of the graph alone", "&View", 5, "Alt+PgDown",
               enabled=with_storeys),
        Action("storey_all", "All sto&reys", "Show every floor of the graph", "&View", 5, "Alt+Home",
               enabled=with_storeys),
    )  # fmt: skip

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._storeys = workspace.document.storeys
        self.choice = QComboBox(workspace.window)
        self.choice.setToolTip("Which floor of the graph is shown (Alt+PgUp, Alt+PgDown)")
        self.choice.setAccessibleName("Storey")
        self.choice.activated.connect(self._choose)
        self.choice.hide()

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "storey_up": lambda: self._storeys.step(1),
            "storey_down": lambda: self._storeys.step(-1),
            "storey_all": lambda: self._storeys.choose(None),
        }

    def restore(self, settings: QSettings) -> None:
        plan = self.workspace.part(MapPart).view
        self.choice.setParent(plan)
        self.choice.move(_EDGE, _EDGE)
        self._storeys.changed.connect(self._show)
        self.workspace.document.unitsChanged.connect(self._show)
        self._storeys.changed.connect(self.workspace.scene.update)
        self._storeys.changed.connect(plan.graph.update)
        self._show()

    def _choose(self, row: int) -> None:
        self._storeys.choose(None if row == 0 else len(self._storeys.found) - row)

    def _show(self) -> None:
        found = self._storeys.found
        self.choice.clear()
        self.choice.addItem("All storeys")
        # As in a lift: the highest on top.
        for number, storey in reversed(list(enumerate(found, 1))):
            self.choice.addItem(f"Storey {number}, {lengths.length(storey.floor, 1)}, {storey.count:,} viewpoints")
        self.choice.setCurrentIndex(0 if self._storeys.chosen is None else len(found) - self._storeys.chosen)
        self.choice.setVisible(len(found) > 1)
        self.choice.adjustSize()
        self.choice.raise_()
        self.workspace.window.actions_table.refresh()
