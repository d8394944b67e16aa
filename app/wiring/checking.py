"""What is wrong with the graph and what a user should look at next."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from app.actions import Action
from app.layers.labels import short_ids
from app.panels.validation import ValidationPanel, selection_of
from app.state.graph_reasons import with_editing, writable
from app.wiring.part import Dock, Part, Workspace
from app.wiring.selecting import SelectPart
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey


class CheckPart(Part):
    """The review begins at the least certain edge: N goes to the next, Y says it is right and goes on, Del takes it
    out of the graph."""

    ACTIONS = (
        Action("next_review", "&Next to review", "The least certain edge that nobody reviewed; again: the one after it",
               "&Graph", 1, "N", "next_review", toolbar=True, enabled=with_editing),
        Action("accept_review", "It is &right, go on", "Mark what is selected as reviewed and go to the next",
               "&Graph", 1, "Shift+N", enabled=writable),
        Action("next_finding", "Next &finding", "Go to the next thing that is wrong with the graph, the worst first",
               "&Graph", 1, "F8", enabled=with_editing),
        Action("validation", "&Validation", "What is wrong with the graph", "&Graph", 1, "Shift+F8",
               enabled=with_editing),
    )  # fmt: skip

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.panel = ValidationPanel(workspace.document)
        self.panel.activated.connect(self._show)
        self._passed: set[EdgeKey] = set()  # looked at and left as they were, in this review
        self._told: GraphSelection | None = None  # what the status bar speaks of
        self._why = ""  # why it is to be reviewed, where it is
        workspace.document.projectChanged.connect(self._passed.clear)
        workspace.document.editing.selectionChanged.connect(self._on_selection)
        workspace.document.graphChanged.connect(self._on_edit)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("validation", "Validation", self.panel, "right", "details", needs=with_editing),)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "next_review": self.next,
            "accept_review": self.accept,
            "next_finding": self.next_finding,
            "validation": lambda: self.workspace.window.show_dock("validation"),
        }

    @property
    def reviewing(self) -> bool:
        """Whether the status bar tells of the edge that is looked at."""
        return bool(self._why) and self._told is not None and self._told == self.workspace.document.editing.selection

    def next(self) -> None:
        """Goes to the least certain edge that was neither reviewed nor passed over since the review began."""
        editing = self.workspace.document.editing
        if editing.graph is None:
            return
        self._passed |= editing.selection.edges
        waiting = editing.review.order(editing.graph)
        left = [doubt for doubt in waiting if doubt.edge not in self._passed]
        if not waiting:
            self.workspace.notices.info("Every edge is reviewed.")
            return
        if not left:
            self._passed.clear()
            left = waiting
        self._show(GraphSelection(frozenset(), frozenset({left[0].edge})))
        self._told = editing.selection
        self._say_review(left[0].why)

    def _say_review(self, why: str) -> None:
        editing = self.workspace.document.editing
        assert editing.graph is not None  # asked before
        self._why = why
        done = sum(edge.reviewed for edge in editing.graph.edges.values())
        self.workspace.modes.said.emit(
            f"{why[0].upper()}{why[1:]} · {done:,} of {len(editing.graph.edges):,} edges are reviewed · N next · "
            "Y it is right · Shift+N right, go on · Del remove it"
        )

    def next_finding(self) -> None:
        """Brings the list of findings to the front and the one after the current before the eye."""
        self.workspace.window.show_dock("validation")
        found = self.panel.step()
        if found is None:
            self.workspace.notices.info("Nothing wrong was found.")
        else:
            self._show(selection_of(found))
            self._told, self._why = selection_of(found), ""
            fix = f" · Fix: {found.fixes[0].text}" if found.fixes else ""
            self.workspace.modes.said.emit(f"{short_ids(self.workspace.document.graph, found.message)} F8 next{fix}")

    def _on_edit(self, _: object) -> None:
        """How many are reviewed is said of the graph as it is."""
        if self.reviewing and self.workspace.document.editing.graph is not None:
            self._say_review(self._why)

    def _on_selection(self) -> None:
        """What was said of something is said no more when something else is selected."""
        if self._told is not None and self.workspace.document.editing.selection != self._told:
            self._told = None
            modes = self.workspace.modes
            modes.said.emit(modes.current.hint)

    def accept(self) -> None:
        """What is selected is right; the next one."""
        editing = self.workspace.document.editing
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
        self.workspace.part(SelectPart).show_selection(chosen)
