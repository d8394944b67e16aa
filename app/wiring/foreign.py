"""Commands for graph files without a project: saving under another name, and a list of the scans in the folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QComboBox, QFileDialog

from app.actions import Action
from app.look.plain_text import CAPTION, plain
from app.state.graph_files import ForeignGraph
from app.state.graph_reasons import with_file_of_its_own
from app.wiring.part import Part, WindowContext
from nvsim.errors import InputError
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.foreign import words_of_saving


class ForeignPart(Part):
    """Saves copies of a graph file, and switches between the scans of its folder."""

    ACTIONS = (
        Action("save_as", "Save &as…",
               "Write the graph to another file and open it; the current file keeps its last saved state", "&File", 1,
               "Ctrl+Shift+S", enabled=with_file_of_its_own),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.scans = QComboBox(context.window)
        self.scans.setToolTip("The scans of this folder (Ctrl+PgDown, Ctrl+PgUp)")
        self.scans.setAccessibleName("Scan")
        self.scans.setMaxVisibleItems(24)
        self.scans.activated.connect(self._choose)
        self.scans.hide()
        context.document.contentsChanged.connect(self._on_contents)
        context.document.projectChanged.connect(self._on_project)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"save_as": self.choose_copy}

    def choose_copy(self) -> None:
        file, path = self.context.document.contents.graph_file, self.context.document.path
        if not isinstance(file, ForeignGraph) or path is None:
            return
        stem = path.name.removesuffix(SUFFIX) if path.name.endswith(SUFFIX) else path.stem
        start = str(path.with_name(f"{stem}-edited{SUFFIX}"))
        pattern = f"Connectivity (*{SUFFIX})"
        name, _ = QFileDialog.getSaveFileName(self.context.window, "Save the graph as", start, pattern)
        if name:
            self.save_copy(Path(name))

    def save_copy(self, path: Path) -> None:
        """Writes the graph to another file and opens it. Unsaved edits are only in the copy."""
        document, editing = self.context.document, self.context.document.editing
        file, history = document.contents.graph_file, editing.history
        if not isinstance(file, ForeignGraph) or history is None:
            return
        if path.suffix.lower() != ".json":
            path = path.with_name(path.name + SUFFIX)
        if document.path is not None and path.exists() and path.samefile(document.path):
            editing.save()
            return
        try:
            file.save_copy(history.graph, path)
        except InputError as error:
            self.context.notices.error(str(error), about="save graph")
            return
        self.context.notices.info(words_of_saving(path, None, history.graph), about="save graph")
        if editing.writable and history.saved_index >= 0:
            history.go_to(history.saved_index)  # otherwise the next opening would restore the edits
        self.context.window.projectChosen.emit(path)

    def restore(self, settings: QSettings) -> None:
        self.context.window.statusBar().addPermanentWidget(self.scans)
        self.scans.hide()

    def _on_project(self) -> None:
        self.scans.hide()

    def _on_contents(self, parts: frozenset[str]) -> None:
        contents = self.context.document.contents
        file = contents.graph_file
        if "graph" in parts and isinstance(file, ForeignGraph) and len(file.scans) > 1:
            self.scans.clear()
            for path in file.scans:
                self.scans.addItem(plain(path.name.removesuffix(SUFFIX), CAPTION), path)
            self.scans.setCurrentIndex(file.scans.index(contents.path) if contents.path in file.scans else -1)
            self.scans.show()

    def _choose(self, row: int) -> None:
        self.context.window.projectChosen.emit(self.scans.itemData(row))
