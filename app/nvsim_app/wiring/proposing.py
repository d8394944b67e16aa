"""Proposed edges and viewpoints. They are drawn dashed until the user accepts or dismisses them. New and moved
viewpoints are measured in the background."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtGui import QPainter

from nvsim.graph.difference import Difference
from nvsim.graph.proposals import PlaceProposal, propose_edges, propose_viewpoints
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey
from nvsim.mapping.evidence.new_viewpoints import NewViewpointEvidence, with_new_viewpoints
from nvsim.mapping.explanation.explain import smallest_margin
from nvsim.plain_text import count_text
from nvsim.project.stages.measured import unmeasured_viewpoints
from nvsim_app.actions import Action
from nvsim_app.look import colors
from nvsim_app.modes.mode import Pointer, dots, line
from nvsim_app.painting.picking import nearest_segment
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state import edit_commands
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, with_map, writable
from nvsim_app.state.side_work import EVIDENCE, evidence_task
from nvsim_app.views.graph_surface import EDGE_REACH, GraphSurface
from nvsim_app.wiring.part import Part, WindowContext

REST = 1500  # milliseconds without an edit until measuring starts, so that a series of edits is not interrupted


class ProposePart(Part):
    """Measures edited viewpoints, and proposes edges and viewpoints."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.proposals = context.document.editing.proposals
        self._automatic = True
        self._search = BackgroundWork("proposals", self)
        self.process = SideProcess(EVIDENCE, self)
        self.process.ended.connect(self._on_end)
        self._soon = QTimer(self, singleShot=True, interval=REST)
        self._soon.timeout.connect(self.measure)
        document = context.document
        document.graphChanged.connect(self._on_edit)
        document.projectChanged.connect(self._on_project)
        context.modes.layers.append(self.paint)

    def _set_automatic(self, on: bool) -> None:
        self._automatic = on
        if on:
            self._soon.start()

    def _on_edit(self, change: Difference) -> None:
        self._prune()
        if self._automatic and (change.added_viewpoints or change.changed_viewpoints):
            self._soon.start()

    def _on_project(self) -> None:
        self.process.close()
        self._soon.stop()
        self.dismiss()

    def measure(self) -> None:
        """Starts to measure viewpoints without evidence."""
        document = self.context.document
        graph, project = document.graph, document.project
        if graph is None or project is None or not project.is_dir() or document.contents.scene_stamp is None:
            return
        if not document.editing.writable or self.process.running:
            return
        if ids := unmeasured_viewpoints(graph)[-8:]:
            self.process.open(evidence_task(project, graph, ids))

    def _on_end(self, end: EndMessage) -> None:
        if end.sentence:
            self.context.notices.warning(end.sentence, end.trace)
        else:
            self._on_measured(end.value.evidence, end.value.positions)

    def _on_measured(self, found: NewViewpointEvidence, places: dict[str, tuple[float, float, float]]) -> None:
        graph = self.context.document.graph
        if graph is None:
            return
        stayed = {
            id for id, place in places.items() if id in graph.viewpoints and graph.viewpoints[id].position == place
        }
        fresh = NewViewpointEvidence(
            tuple(e for e in found.evidence if (e.viewpoint in stayed or e.joins in stayed)
                  and not {e.viewpoint, e.joins} & (places.keys() - stayed)),
            {id: submap for id, submap in found.submaps.items() if id in stayed},
            (), (),
        )  # fmt: skip
        if stayed:
            editing = self.context.document.editing
            editing.amend("Measure edited viewpoints", with_new_viewpoints(graph, fresh))
            self.proposals.add(editing.graph or graph, found.proposed, found.doubted)
            self._prune()
            self._announce_change()
            if found.proposed:
                count = len(found.proposed)
                self.context.notices.info(
                    f"{count} {'edge is' if count == 1 else 'edges are'} proposed at your edits: Ctrl+Return accepts "
                    f"{'it' if count == 1 else 'them'}, Ctrl+Backspace dismisses {'it' if count == 1 else 'them'}."
                )
        if len(stayed) < len(places) or unmeasured_viewpoints(graph):
            self._soon.start()

    def propose_edges(self) -> None:
        """Tests all pairs of nearby viewpoints, in a thread."""
        document = self.context.document
        graph, occupancy = document.graph, document.contents.occupancy
        if graph is not None:
            slack = smallest_margin(document.contents.thresholds)
            file = document.contents.graph_file
            seen = None if file is None or occupancy is not None else file.visibility(unknown=False)
            self._start_work(lambda: (tuple(p.edge for p in propose_edges(graph, occupancy, slack, visible=seen)), ()))

    def propose_viewpoints(self) -> None:
        """Searches the whole map, in a thread."""
        document = self.context.document
        graph, occupancy = document.graph, document.contents.occupancy
        if graph is not None and occupancy is not None:
            self._start_work(lambda: ((), propose_viewpoints(graph, occupancy)))

    def _start_work(self, work: Callable[[], tuple[tuple[EdgeKey, ...], tuple[PlaceProposal, ...]]]) -> None:
        if not self._search.busy:
            self._search.start(work, self._on_found, self.context.notices.warning)

    def _on_found(self, found: tuple[tuple[EdgeKey, ...], tuple[PlaceProposal, ...]]) -> None:
        edges, places = found
        graph = self.context.document.graph
        if graph is None:
            return
        self.proposals.add(graph, edges, (), places)
        self._prune()
        self._announce_change()
        words = count_text(len(places), "viewpoint") if places else count_text(len(edges), "edge")
        if edges or places:
            one = len(edges) + len(places) == 1
            self.context.notices.info(
                f"{words} {'is' if one else 'are'} proposed: Ctrl+Return accepts {'it' if one else 'them'}, "
                f"Ctrl+Backspace dismisses {'it' if one else 'them'}; a right click accepts a single edge."
            )
        else:
            self.context.notices.info("There is nothing to propose.")

    def accept(self) -> None:
        """Adds all proposals, as one step."""
        editing, kept = self.context.document.editing, self.proposals
        pairs, places = [list(key) for key in kept.edges], kept.places
        self.dismiss()
        steps: list[tuple[str, dict[str, object]]] = [
            ("add_viewpoint", {"position": list(p.position), "height": p.height, "id": p.new_id}) for p in places
        ]
        pairs += [[place.new_id, other] for place in places for other in place.joins]
        if pairs:
            steps.append(("add_edges", {"pairs": pairs}))
        if steps:
            chosen = GraphSelection(frozenset(place.new_id for place in places)) if places else None
            text = f"Add {count_text(len(places), 'proposed viewpoint')}" if places else ""
            editing.run_all(steps, text, selection=chosen)

    def proposal_under(self, pointer: Pointer) -> EdgeKey | None:
        """The proposed edge under the mouse pointer."""
        keys, ends = self._visible_proposals(self.proposals.edges)
        lines, index, depths = pointer.surface.segments(ends[:, 0], ends[:, 1])
        row = nearest_segment(lines, depths, (pointer.point.x(), pointer.point.y()), EDGE_REACH)
        return None if row is None else keys[int(index[row])]

    def accept_edge(self, edge: EdgeKey) -> None:
        """Adds one proposed edge. The others stay proposed."""
        edit_commands.add_edge(self.context.document.editing, *edge)

    def dismiss_edge(self, edge: EdgeKey) -> None:
        """Dismisses one proposed edge."""
        self.proposals.remove_edge(edge)
        self._announce_change()

    def _visible_proposals(self, edges: tuple[EdgeKey, ...]) -> tuple[list[EdgeKey], NDArray[np.float64]]:
        """The edges whose ends are visible, and their ends on the floor, (N, 2, 3) world meters."""
        arrays = self.context.document.shown_arrays
        keys = [(a, b) for a, b in edges if a in arrays.index and b in arrays.index]
        rows = np.array([(arrays.index[a], arrays.index[b]) for a, b in keys], np.int64).reshape(-1, 2)
        return keys, arrays.feet[rows]

    def dismiss(self) -> None:
        self.proposals.clear()
        self._announce_change()

    def _prune(self) -> None:
        if self.proposals.prune(self.context.document.graph):
            self._announce_change()

    def _announce_change(self) -> None:
        self.context.document.editing.stepsChanged.emit()
        self.context.modes.refresh()

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        for edges, color in ((self.proposals.edges, colors.OPEN), (self.proposals.doubted, colors.BLOCKED)):
            keys, ends = self._visible_proposals(edges)
            if keys:
                line(painter, surface, ends[:, 0], ends[:, 1], color, 3.0, Qt.PenStyle.DashLine)
        arrays, places = self.context.document.graph_arrays, self.proposals.places
        feet = np.array([(*p.position[:2], p.position[2] - p.height) for p in places], float).reshape(-1, 3)
        foot = {place.new_id: at for place, at in zip(places, feet, strict=True)}
        joins = [
            (foot[place.new_id], foot[other] if other in foot else arrays.feet[arrays.index[other]])
            for place in places
            for other in place.joins
            if other in foot or other in arrays.index
        ]
        if joins:
            way = np.array(joins)
            line(painter, surface, way[:, 0], way[:, 1], colors.OPEN, 2.0, Qt.PenStyle.DashLine)
        dots(painter, surface, feet, colors.OPEN, 7.0, filled=False)

    def store(self, settings: QSettings) -> None:
        self.process.close()
        self._search.stop()

    ACTIONS = (
        Action("&Graph", 3, "measure_automatically", "Measure &added or moved viewpoints",
               "Measure the evidence of new and moved viewpoints in the background and propose edges", _set_automatic,
               enabled=writable, check="on"),
        Action("&Graph", 3, "propose_edges", "Propose &edges",
               "Propose edges that evidence and map allow and that shorten a detour", propose_edges,
               enabled=lambda document: _with_grounds(document)),
        Action("&Graph", 3, "propose_viewpoints", "Propose v&iewpoints",
               "Propose viewpoints at free places without a viewpoint nearby", propose_viewpoints, enabled=with_map),
        Action("&Graph", 3, "accept_proposals", "A&ccept proposals",
               "Add the proposed edges and viewpoints to the graph", accept, "Ctrl+Return",
               lambda document: _with_proposals(document)),
        Action("&Graph", 3, "dismiss_proposals", "&Dismiss proposals", "Remove the proposed edges and viewpoints",
               dismiss, "Ctrl+Backspace", lambda document: _with_proposals(document)),
    )  # fmt: skip


def _with_grounds(document: Document) -> Reason:
    if (first := with_map(document)) is None or document.graph is None or not document.editing.writable:
        return first
    file = document.contents.graph_file
    if document.graph.evidence or (file is not None and file.visibility() is not None):
        return None
    return "there is neither evidence nor a map to propose from"


def _with_proposals(document: Document) -> Reason:
    if (first := writable(document)) is not None:
        return first
    return None if document.editing.proposals else "nothing is proposed"
