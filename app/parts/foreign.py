"""What the window shows while a graph of its own is open: the panels of the editor before those of a project, and a
choice of the scans of its folder."""

from __future__ import annotations

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QComboBox

from app.graph_files import ForeignGraph
from app.parts.part import Part, Workspace
from app.plain_text import CAPTION, plain
from nvsim.graph.connectivity import SUFFIX

_OF_A_GRAPH = ("layers", "history", "tables", "validation")
_OF_A_PROJECT = ("submaps", "frames", "jobs", "details")


class ForeignPart(Part):
    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._alone = False
        self.scans = QComboBox(workspace.window)
        self.scans.setToolTip("The scans of this folder (Ctrl+PgDown, Ctrl+PgUp)")
        self.scans.setAccessibleName("Scan")
        self.scans.setMaxVisibleItems(24)
        self.scans.activated.connect(self._choose)
        self.scans.hide()
        workspace.document.contentsChanged.connect(self._on_contents)
        workspace.document.projectChanged.connect(self._on_project)

    def restore(self, settings: QSettings) -> None:
        self.workspace.window.statusBar().addPermanentWidget(self.scans)
        self.scans.hide()

    def _on_project(self) -> None:
        self.scans.hide()

    def _on_contents(self, parts: frozenset[str]) -> None:
        contents = self.workspace.document.contents
        file = contents.graph_file
        alone = isinstance(file, ForeignGraph)
        if "graph" in parts and isinstance(file, ForeignGraph) and len(file.scans) > 1:
            self.scans.clear()
            for path in file.scans:
                self.scans.addItem(plain(path.name.removesuffix(SUFFIX), CAPTION), path)
            self.scans.setCurrentIndex(file.scans.index(contents.path) if contents.path in file.scans else -1)
            self.scans.show()
        if contents.graph is not None and alone != self._alone:
            self._alone = alone
            for name in _OF_A_GRAPH if alone else _OF_A_PROJECT:
                self.workspace.window.front_dock(name)

    def _choose(self, row: int) -> None:
        self.workspace.window.projectChosen.emit(self.scans.itemData(row))
