"""What the machine proposes: edges that pass where a viewpoint was added or moved, drawn as ghosts until a person takes
or dismisses them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtGui import QPainter

from app import colors
from app.actions import Action
from app.document import Document
from app.evidence_child import EvidenceChild
from app.graph_reasons import writable
from app.graph_surface import GraphSurface
from app.modes.ink import line
from app.parts.part import Part, Workspace
from app.proposals import Proposals
from app.reasons import Reason
from nvsim.graph.difference import Difference
from nvsim.mapping.newcomers import Newcomers, with_newcomers
from nvsim.project.stages.measured import unmeasured

REST = 1500  # milliseconds without an edit until measuring begins: a hand that places several is not interrupted


class ProposePart(Part):
    ACTIONS = (
        Action(
            "measure_automatically", "Measure what I &add or move",
            "Measure the evidence of new and moved viewpoints in the background and propose edges", "&Graph", 3,
            check="on", enabled=writable,
        ),
        Action(
            "accept_proposals", "&Take proposals", "Add the edges that are drawn as ghosts", "&Graph", 3,
            "Ctrl+Return", enabled=lambda document: _with_proposals(document),
        ),
        Action(
            "dismiss_proposals", "&Dismiss proposals", "Draw them no more", "&Graph", 3,
            "Ctrl+Backspace", enabled=lambda document: _with_proposals(document),
        ),
    )  # fmt: skip

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._automatic = True
        self.child = EvidenceChild(self)
        self.child.measured.connect(self._on_measured)
        self.child.failed.connect(workspace.notices.warning)
        self._soon = QTimer(self, singleShot=True, interval=REST)
        self._soon.timeout.connect(self.measure)
        document = workspace.document
        document.graphChanged.connect(self._on_edit)
        document.projectChanged.connect(self._on_project)
        workspace.modes.layers.append(self.paint)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "measure_automatically": self._set_automatic,
            "accept_proposals": self.accept,
            "dismiss_proposals": self.dismiss,
        }

    @property
    def proposals(self) -> Proposals:
        return self.workspace.document.editing.proposals

    def _set_automatic(self, on: bool) -> None:
        self._automatic = on
        if on:
            self._soon.start()

    def _on_edit(self, change: Difference) -> None:
        self._prune()
        if self._automatic and (change.added_viewpoints or change.changed_viewpoints):
            self._soon.start()

    def _on_project(self) -> None:
        self.child.stop()
        self._soon.stop()
        self.dismiss()

    def measure(self) -> None:
        """Starts measuring what was not measured yet."""
        document = self.workspace.document
        graph, project = document.graph, document.project
        if graph is None or project is None or not project.is_dir() or document.contents.scene_stamp is None:
            return
        if not document.editing.writable or self.child.busy:
            return
        self.child.start(project, graph, unmeasured(graph)[-8:])

    def _on_measured(self, found: Newcomers, places: dict[str, tuple[float, float, float]]) -> None:
        graph = self.workspace.document.graph
        if graph is None:
            return
        stayed = {
            id for id, place in places.items() if id in graph.viewpoints and graph.viewpoints[id].position == place
        }
        fresh = Newcomers(
            tuple(e for e in found.evidence if (e.viewpoint in stayed or e.joins in stayed)
                  and not {e.viewpoint, e.joins} & (places.keys() - stayed)),
            {id: submap for id, submap in found.submaps.items() if id in stayed},
            (), (),
        )  # fmt: skip
        if stayed:
            self.workspace.document.editing.amend("Measure what was edited", with_newcomers(graph, fresh))
            self.proposals.add(found.proposed, found.doubted)
            self._prune()
            self._tell()
            if found.proposed:
                count = len(found.proposed)
                self.workspace.notices.info(
                    f"{count} {'edge is' if count == 1 else 'edges are'} proposed where you edited: Ctrl+Return takes "
                    f"{'it' if count == 1 else 'them'}, Ctrl+Backspace does not."
                )
        if len(stayed) < len(places) or unmeasured(graph):
            self._soon.start()

    def accept(self) -> None:
        """All proposed edges as one step."""
        pairs = [list(key) for key in self.proposals.edges]
        self.dismiss()
        if pairs:
            self.workspace.document.editing.run("add_edges", {"pairs": pairs})

    def dismiss(self) -> None:
        self.proposals.clear()
        self._tell()

    def _prune(self) -> None:
        if self.proposals.prune(self.workspace.document.graph):
            self._tell()

    def _tell(self) -> None:
        self.workspace.document.editing.stepsChanged.emit()
        self.workspace.modes.refresh()

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        arrays = self.workspace.document.graph_arrays
        for keys, color in ((self.proposals.edges, colors.OPEN), (self.proposals.doubted, colors.BLOCKED)):
            pairs = [(arrays.index[a], arrays.index[b]) for a, b in keys if a in arrays.index and b in arrays.index]
            if pairs:
                ends = arrays.feet[np.array(pairs)]
                line(painter, surface, ends[:, 0], ends[:, 1], color, 3.0, Qt.PenStyle.DashLine)

    def store(self, settings: QSettings) -> None:
        self.child.stop()


def _with_proposals(document: Document) -> Reason:
    if (first := writable(document)) is not None:
        return first
    return None if document.editing.proposals else "nothing is proposed"
