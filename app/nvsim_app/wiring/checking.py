"""The findings about the graph, the review of its edges, and its comparison with another graph."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtWidgets import QFileDialog

from nvsim.files.user_folders import home_folder
from nvsim.graph.compare import Deviation, merge
from nvsim.graph.edits import EditError
from nvsim.graph.review import reviewable_edges
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey
from nvsim.plain_text import capitalized
from nvsim_app.actions import Action
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.modes.mode import dots, line
from nvsim_app.painting.picking import NEAR
from nvsim_app.panels.comparison import INKS, ComparedGraphs, ComparePanel, read_graph
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.panels.validation import ValidationPanel, selection_of
from nvsim_app.state.directions import first_obstacle_on_edge
from nvsim_app.state.reasons import with_editing, writable
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.wiring.part import Dock, Part, WindowContext
from nvsim_app.wiring.selecting import SelectPart

_MARK = 9.0  # radius of the mark of an obstacle, pixels


class CheckPart(Part):
    """Commands of the validation and the review. The review starts at the least certain edge: N goes to the next one, Y
    marks it as reviewed, and Del removes it."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.panel = ValidationPanel(context.document)
        self.panel.activated.connect(self._show)
        self._passed: set[EdgeKey] = set()  # edges that were skipped in this review
        self._described: GraphSelection | None = None  # the selection that the status bar describes
        self._why = ""  # the reason to review it; "" for a finding
        self._blocked: NDArray[np.float64] | None = None
        context.modes.layers.append(self._paint_blocked)
        context.document.projectChanged.connect(self._passed.clear)
        context.document.editing.selectionChanged.connect(self._on_selection)
        context.document.graphChanged.connect(self._on_edit)

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("validation", "Validation", self.panel, "right", "details", needs=with_editing, workspaces=("edit",)),
        )

    @property
    def reviewing(self) -> bool:
        """Whether the status bar describes the edge under review."""
        return (
            bool(self._why)
            and self._described is not None
            and self._described == self.context.document.editing.selection
        )

    def next(self) -> None:
        """Goes to the least certain edge that was neither reviewed nor skipped in this review."""
        editing = self.context.document.editing
        if editing.graph is None:
            return
        self._passed |= editing.selection.edges
        waiting = editing.review.order(editing.graph)
        left = [doubt for doubt in waiting if doubt.edge not in self._passed]
        if not waiting:
            self.context.notices.info("Every edge between included viewpoints is reviewed.")
            return
        if not left:
            self._passed.clear()
            left = waiting
        self._show(GraphSelection(frozenset(), frozenset({left[0].edge})))
        self._described = editing.selection
        self._say_review(left[0].why)

    def _say_review(self, why: str) -> None:
        editing = self.context.document.editing
        assert editing.graph is not None  # checked by the callers
        self._why = why
        edges = reviewable_edges(editing.graph)
        done = sum(editing.graph.edges[key].reviewed for key in edges)
        self.context.modes.said.emit(
            f"{capitalized(why)} · {done:,} of {len(edges):,} edges are reviewed · N next · "
            "Y reviewed · Shift+N reviewed, next · Del remove"
        )

    def next_finding(self) -> None:
        """Shows the list of findings, and goes to the next one."""
        self.context.window.show_dock("validation")
        found = self.panel.step()
        if found is None:
            self.context.notices.info(self.panel.reason_for_no_findings)
        else:
            self._show(selection_of(found))
            self._described, self._why = selection_of(found), ""
            fix = f" · Fix: {found.fixes[0].text}" if found.fixes else ""
            self.context.modes.said.emit(f"{short_ids(self.context.document.graph, found.message)} F8 next{fix}")

    def _on_edit(self, _: object) -> None:
        """Updates the place of the obstacle and the number of reviewed edges after an edit."""
        self._find_blocked()
        if self.reviewing and self.context.document.editing.graph is not None:
            self._say_review(self._why)

    def _on_selection(self) -> None:
        """Marks the obstacle on a selected edge with a finding, and restores the hint of the mode."""
        self._find_blocked()
        if self._described is not None and self.context.document.editing.selection != self._described:
            self._described = None
            modes = self.context.modes
            modes.said.emit(modes.current.hint)

    def _find_blocked(self) -> None:
        editing = self.context.document.editing
        edges, finding = editing.selection.edges, self.panel.current
        ours = finding is not None and edges == frozenset(finding.edges) and len(edges) == 1
        self._blocked = first_obstacle_on_edge(self.context.document, next(iter(edges))) if ours else None

    def _paint_blocked(self, painter: QPainter, surface: GraphSurface) -> None:
        """A cross in a circle on the floor at the obstacle."""
        if self._blocked is None:
            return
        (pixel,), (depth,) = surface.project(self._blocked[None])
        if depth <= NEAR:
            return
        for color, width in (("#ffffff", 5.0), (colors.BLOCKED, 2.5)):
            painter.setPen(QPen(QColor(color), width))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            middle, arm = QPointF(*pixel), _MARK / 2
            painter.drawEllipse(middle, _MARK, _MARK)
            painter.drawLine(middle - QPointF(arm, arm), middle + QPointF(arm, arm))
            painter.drawLine(middle - QPointF(arm, -arm), middle + QPointF(arm, -arm))

    def accept(self) -> None:
        """Marks the selection as reviewed, and goes to the next edge."""
        editing = self.context.document.editing
        chosen = editing.selection
        graph = editing.graph
        if graph is None:
            return
        ids = sorted(id for id in chosen.viewpoints if not graph.viewpoints[id].reviewed)
        edges = [list(key) for key in sorted(chosen.edges) if not graph.edges[key].reviewed]
        if (ids or edges) and not editing.run("mark_reviewed", {"viewpoints": ids, "edges": edges}):
            return
        self.next()

    def _show(self, chosen: GraphSelection) -> None:
        self.context.part(SelectPart).show_selection(chosen)

    ACTIONS = (
        Action("&Graph", 1, "next_review", "&Next to review",
               "Go to the least certain unreviewed edge; again: the next one", next, "N", with_editing,
               icon="next_review", toolbar=True),
        Action("&Graph", 1, "accept_review", "Mark &reviewed and continue",
               "Mark the selection as reviewed and go to the next edge", accept, "Shift+N", writable),
        Action("&Graph", 1, "next_finding", "Next &finding",
               "Go to the next finding about the graph, most severe first", next_finding, "F8", with_editing),
        Action("&Graph", 1, "validation", "&Validation", "Show the findings about the graph",
               lambda self: self.context.window.show_dock("validation"), "Shift+F8", with_editing),
    )  # fmt: skip


SETTLE = 200  # milliseconds after an edit until it is compared again

_STYLES = {"edge removed": Qt.PenStyle.DotLine}


class ComparePart(Part):
    """Compares graphs, draws their differences, and merges selected differences."""

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
        self._soon.timeout.connect(self._compare_again)
        context.document.graphChanged.connect(self._on_edit)
        context.document.projectChanged.connect(self.close)
        self._steps = DeferredRefresh(self.panel, self._on_steps, SETTLE)
        self._editing.stepsChanged.connect(self._steps.mark)
        context.modes.layers.append(self.paint)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("compare", "Compare", self.panel, "left", "frames", needs=with_editing, workspaces=("compare",)),)

    def choose_file(self) -> None:
        window = self.context.window
        start = str(self.context.document.path or home_folder())
        name, _ = QFileDialog.getOpenFileName(window, "Compare with", start, "Connectivity (*.json)")
        if name:
            self.compare_with_file(Path(name))

    def compare_with_file(self, path: Path) -> None:
        """Compares with a connectivity file or a project. A read error becomes a notice."""
        with self.context.notices.reporting(about="compare"):
            other = read_graph(path)
            self.context.notices.resolve("compare")
            if self._editing.graph is not None:
                self._set_compared(ComparedGraphs.of(path.name, self._editing.graph, other))

    def compare_with_step(self, index: int) -> None:
        """Compares with the graph after a step of the history."""
        history = self._editing.history
        if history is not None and 0 <= index < len(history.steps):
            self._set_compared(
                ComparedGraphs.of(f"After “{history.steps[index].text}”", history.graph, history.graph_at(index))
            )

    def close(self) -> None:
        self._set_compared(None)

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

    def _set_compared(self, compared: ComparedGraphs | None) -> None:
        if compared is None and self.panel.compared is None:
            return
        self.panel.show_compared(compared)
        self.context.modes.refresh()

    def _on_edit(self, _: object) -> None:
        if self.panel.compared is not None:
            self._soon.start()

    def _compare_again(self) -> None:
        before, graph = self.panel.compared, self._editing.graph
        if before is not None and graph is not None:
            self._set_compared(ComparedGraphs.of(before.name, graph, before.other))

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

    ACTIONS = (
        Action("&Graph", 2, "compare", "&Compare…", "Show the differences to another graph or to an earlier step",
               lambda self: self.context.window.show_dock("compare"), "F9", with_editing),
    )  # fmt: skip
