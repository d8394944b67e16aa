"""The comparison of the graph with another graph, or with an earlier step of the history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QFileDialog

from app.actions import Action
from app.modes.ink import dots, line
from app.panels.comparison import INKS, ComparePanel
from app.panels.deferred_refresh import DeferredRefresh
from app.state.comparing import Compared, read_graph
from app.state.graph_reasons import with_editing
from app.views.graph_surface import GraphSurface
from app.wiring.part import Dock, Part, WindowContext
from app.wiring.selecting import SelectPart
from nvsim.errors import InputError
from nvsim.files.user_folders import home
from nvsim.graph.compare import Deviation, merge
from nvsim.graph.edits import EditError
from nvsim.graph.selection import GraphSelection

SETTLE = 200  # milliseconds after an edit until it is compared again

_STYLES = {"edge removed": Qt.PenStyle.DotLine}


class ComparePart(Part):
    """Compares graphs, draws their differences, and merges selected differences."""

    ACTIONS = (
        Action("compare", "&Compare…", "Show the differences to another graph or to an earlier step", "&Graph", 2, "F9",
               enabled=with_editing),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._editing = context.document.editing
        self.panel = ComparePanel()
        self.panel.opened.connect(self.choose_file)
        self.panel.stepped.connect(self.compare_with_step)
        self.panel.closed.connect(self.close)
        self.panel.merged.connect(self.merge)
        self.panel.activated.connect(self._show)
        self._soon = QTimer(self, singleShot=True, interval=SETTLE)
        self._soon.timeout.connect(self._again)
        context.document.graphChanged.connect(self._on_edit)
        context.document.projectChanged.connect(self.close)
        self._steps = DeferredRefresh(self.panel, self._on_steps, SETTLE)
        self._editing.stepsChanged.connect(self._steps.mark)
        context.modes.layers.append(self.paint)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("compare", "Compare", self.panel, "left", "frames", needs=with_editing, workspaces=("compare",)),)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"compare": lambda: self.context.window.show_dock("compare")}

    def choose_file(self) -> None:
        window = self.context.window
        start = str(self.context.document.path or home())
        name, _ = QFileDialog.getOpenFileName(window, "Compare with", start, "Connectivity (*.json)")
        if name:
            self.compare_with_file(Path(name))

    def compare_with_file(self, path: Path) -> None:
        """Compares with a connectivity file or a project. A read error becomes a notice."""
        try:
            other = read_graph(path)
        except InputError as error:
            self.context.notices.error(str(error), about="compare")
            return
        self.context.notices.resolve("compare")
        if self._editing.graph is not None:
            self._set(Compared.of(path.name, self._editing.graph, other))

    def compare_with_step(self, index: int) -> None:
        """Compares with the graph after a step of the history."""
        history = self._editing.history
        if history is not None and 0 <= index < len(history.steps):
            self._set(Compared.of(f"After “{history.steps[index].text}”", history.graph, history.graph_at(index)))

    def close(self) -> None:
        self._set(None)

    def merge(self, chosen: list[Deviation]) -> None:
        """Applies the selected differences, as one step."""
        compared = self.panel.compared
        if compared is None:
            return
        try:
            graph = merge(compared.mine, compared.other, compared.comparison, chosen)
        except EditError as error:
            self._editing.refuse(str(error))
            self.context.notices.warning(str(error))
            return
        count = len(chosen)
        self._editing.perform(
            f"Merge {count:,} {'difference' if count == 1 else 'differences'} from {compared.name}", graph
        )

    def _set(self, compared: Compared | None) -> None:
        if compared is None and self.panel.compared is None:
            return
        self.panel.show_compared(compared)
        self.context.modes.refresh()

    def _on_edit(self, _: object) -> None:
        if self.panel.compared is not None:
            self._soon.start()

    def _again(self) -> None:
        before, graph = self.panel.compared, self._editing.graph
        if before is not None and graph is not None:
            self._set(Compared.of(before.name, graph, before.other))

    def _on_steps(self) -> None:
        history = self._editing.history
        texts = () if history is None else tuple(step.text for step in history.steps)
        self.panel.show_steps(texts, -1 if history is None else history.index)

    def _show(self, chosen: GraphSelection) -> None:
        self.context.part(SelectPart).show_selection(chosen)

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        compared = self.panel.compared
        if compared is None:
            return
        for kind in ("edge removed", "edge added"):
            ends = [(compared.place(d.edge[0]), compared.place(d.edge[1])) for d in compared.of_kind(kind) if d.edge]
            known = np.array([pair for pair in ends if None not in pair], float).reshape(-1, 2, 3)
            line(painter, surface, known[:, 0], known[:, 1], INKS[kind], 3.4, _STYLES.get(kind, Qt.PenStyle.SolidLine))
        for kind in ("viewpoint removed", "viewpoint added", "viewpoint changed"):
            found = [compared.place(d.viewpoint) for d in compared.of_kind(kind)]
            dots(
                painter, surface, np.array([p for p in found if p], float).reshape(-1, 3), INKS[kind], 8.0, filled=False
            )
        moved = [(compared.place(d.viewpoint), compared.other_place(d.viewpoint))
                 for d in compared.of_kind("viewpoint moved")]  # fmt: skip
        ways = np.array([pair for pair in moved if None not in pair], float).reshape(-1, 2, 3)
        line(painter, surface, ways[:, 0], ways[:, 1], INKS["viewpoint moved"], 2.0)
        dots(painter, surface, ways[:, 1], INKS["viewpoint moved"], 5.0)
