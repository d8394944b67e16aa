"""The edited graph: its history, selection, and findings.

The history stores values (nvsim.graph.history), so undo, redo, and a jump to any step are one assignment. The change is
emitted as a difference.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from nvsim.graph.difference import difference
from nvsim.graph.edits import EditError, Visible
from nvsim.graph.findings import Finding
from nvsim.graph.history import History, HistoryChange
from nvsim.graph.operations import EditContext, apply, describe, record
from nvsim.graph.review import Review
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.graph.sight import line_of_sight_test
from nvsim.graph.store import same_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.explain import smallest_margin
from nvsim.occupancy.types import OccupancyMap
from nvsim_app.state.checking import Checking
from nvsim_app.state.graph_files import GraphFile
from nvsim_app.state.graph_saving import GraphSaving
from nvsim_app.state.proposals import Proposals


class Editing(QObject):
    """The editor of the graph.

    graphChanged(Difference)
    selectionChanged()
    stepsChanged()      the steps, the current step, or the saved step changed
    findingsChanged()
    refused(str)        why an edit was not made
    notified(str)           a notice for the user
    failed(str)         an error of reading or writing
    """

    graphChanged = Signal(object)
    selectionChanged = Signal()
    stepsChanged = Signal()
    findingsChanged = Signal()
    refused = Signal(str)
    notified = Signal(str)
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.history: History | None = None
        self.file: GraphFile | None = None
        self.proposals = Proposals()
        self.locked = ""
        """Why the graph cannot be edited, for example because another window edits it; "" if it can."""
        self.checking = Checking(self, self.findingsChanged.emit)
        self._thresholds = MappingConfig()
        self.review = Review(smallest_margin(self._thresholds))
        """The order in which the user reviews edges."""
        self._surroundings = EditContext()
        self._keeping = GraphSaving(self)
        self._keeping.notified.connect(self.notified)
        self._keeping.failed.connect(self.failed)
        self._keeping.saved.connect(self._on_saved)

    # State -------------------------------------------------------------------------------------------------------

    @property
    def graph(self) -> NavGraph | None:
        return None if self.history is None else self.history.graph

    @property
    def selection(self) -> GraphSelection:
        return NOTHING if self.history is None else self.history.selection

    @property
    def writable(self) -> bool:
        return self.history is not None and not self.locked

    @property
    def dirty(self) -> bool:
        """Whether there are unsaved edits."""
        return self.history is not None and not self.history.is_saved

    # Opening and closing -----------------------------------------------------------------------------------------

    def open(self, graph: NavGraph | None, file: GraphFile | None) -> None:
        """Opens `graph` for editing, and restores unsaved edits of an earlier window. If the open file was read again
        and contains another graph, the change becomes a step of the history."""
        again = self.history is not None and graph is not None and file is not None and file is self.file
        if again and graph is not None and self._handle_reread_graph(graph):
            return
        self.close()
        self.file = file
        if graph is not None:
            self.history, self.locked = self._keeping.open(graph, file)
            self.history.listen(self._on_change)
            self.checking.schedule_validation(self.history.graph, file)  # with the restored edits
        self.proposals.prune(self.graph)
        self.selectionChanged.emit()
        self.stepsChanged.emit()

    def _handle_reread_graph(self, graph: NavGraph) -> bool:
        """Handles a graph that was read again from the same file. Returns False if it must be opened as a new graph.

        Usually the graph is unchanged, because a project is read again whenever a stage begins or ends. Otherwise a job
        has built another graph."""
        assert self.history is not None  # checked by the caller
        held = self.history.graph_at(self.history.saved_index) if self.history.saved_index >= 0 else None
        if held is not None and same_graph(held, graph):
            return True
        if self.locked:
            return False
        if self.history.is_saved:
            self.history.replace_from_outside("Map built again by a job", graph)
        else:
            self.notified.emit(
                "A job built the graph of the project again while you edit. You still edit your graph; saving it "
                "replaces the new one. Use Compare to see the differences."
            )
        return True

    def close(self) -> None:
        """Closes the graph. All edits are in the journal when this returns."""
        self._keeping.close()
        self.history, self.file, self.locked = None, None, ""
        self.checking.reset()

    def save(self, wait: bool = False) -> None:
        """Writes the graph to the project or its file in a thread. With `wait`, returns after writing."""
        if self.history is not None and self.file is not None and self.writable:
            self._keeping.save(self.history, self.file, wait)

    # Editing -----------------------------------------------------------------------------------------------------

    def run(
        self,
        name: str,
        arguments: Mapping[str, Any],
        *,
        selection: GraphSelection | None = None,
        merge: str | None = None,
    ) -> bool:
        """Applies one operation of nvsim.graph.operations as one step. Returns whether it was applied; if not, emits
        `refused` with the reason."""
        return self.run_all([(name, arguments)], selection=selection, merge=merge)

    def perform(self, text: str, graph: NavGraph) -> bool:
        """Replaces the graph by `graph` as one step. Returns whether it was replaced; if not, emits `refused`."""
        if self.history is None or not self.writable:
            self.refuse(self.locked or "No navigation graph is open.")
            return False
        self.history.perform(text, graph)
        return True

    def run_all(
        self,
        operations: Iterable[tuple[str, Mapping[str, Any]]],
        text: str = "",
        *,
        selection: GraphSelection | None = None,
        merge: str | None = None,
        skips: bool = False,
    ) -> bool:
        """Applies several operations in order as one step. If one is refused, none is applied; with `skips`, the others
        are applied."""
        if self.history is None or not self.writable:
            self.refuse(self.locked or "No navigation graph is open.")
            return False
        graph, done = self.history.graph, []
        last: EditError | None = None
        try:
            for name, arguments in operations:
                try:
                    graph = apply(graph, name, arguments, self._surroundings)
                except EditError as error:
                    if not skips:
                        raise
                    last = error
                    continue
                done.append((name, arguments))
            if not done and last is not None:
                raise last
            words = text or describe(*done[-1])
        except EditError as error:
            self.refuse(str(error))
            return False
        if graph is self.history.graph:
            self.refuse("The graph already has this state, so nothing changes.")
            return False
        # A unique key allows later measurements to become part of the step.
        key = merge or uuid.uuid4().hex
        if len(done) == 1:
            line = record(*done[0])
        else:
            line = record("together", {"edits": [record(*each) for each in done], "text": words})
        self.history.perform(words, graph, selection, key, line)
        return True

    def amend(self, text: str, graph: NavGraph) -> None:
        """Replaces the graph as part of the current step if that is an edit, else as a new step."""
        if self.history is None or not self.writable:
            return
        last = self.history.steps[self.history.index]
        if last.edit and last.merge is not None:
            self.history.perform(last.text, graph, None, last.merge, last.operation)
        else:
            self.history.perform(text, graph)

    def refuse(self, sentence: str) -> None:
        """Emits why an edit was not made."""
        self.refused.emit(sentence)

    def select(self, selection: GraphSelection) -> None:
        """Replaces the selection; can be undone."""
        if self.history is not None:
            self.history.select(selection)

    def undo(self) -> None:
        if self.history is not None and self.writable:
            self.history.undo()

    def redo(self) -> None:
        if self.history is not None and self.writable:
            self.history.redo()

    def go_to(self, index: int) -> None:
        """Goes to the graph after the step `index`."""
        if self.history is not None and self.writable:
            self.history.go_to(index)

    # Findings ----------------------------------------------------------------------------------------------------

    def set_surroundings(self, occupancy: OccupancyMap | None, trajectory: NDArray[np.float64] | None) -> None:
        """Sets the data that edits may need: the occupancy map, and the positions of the frames (N, 3), meters,
        world."""
        visible: Visible | None = None
        if occupancy is not None:
            visible = partial(_see_each_other, occupancy)
        elif self.file is not None:
            visible = self.file.visibility()
        self._surroundings = EditContext(visible, trajectory)

    def set_thresholds(self, config: MappingConfig) -> None:
        """Sets the thresholds that the review compares evidence with."""
        if config == self._thresholds:
            return
        self._thresholds, self.review = config, Review(smallest_margin(config))

    @property
    def findings(self) -> Mapping[str, Finding]:
        """The findings of the graph by key, including those that the user ignores."""
        return self.checking.findings

    def ignore(self, key: str, reason: str) -> None:
        """Hides the findings with this key: a single finding or all of one kind."""
        self.run("ignore_finding", {"key": key, "reason": reason})

    def show_ignored_again(self, key: str) -> None:
        """Shows the ignored findings with this key again."""
        self.run("heed_finding", {"key": key})

    # After a step --------------------------------------------------------------------------------------------------

    def _on_saved(self) -> None:
        """Validates the graph again if its file adds to the context, because saving changes the lists of the file."""
        if self.file is not None and self.file.foreign:
            self.checking.validate_again()

    def _on_change(self, change: HistoryChange) -> None:
        if change.before_graph is not change.after_graph:
            changed = difference(change.before_graph, change.after_graph)
            self.checking.update(change.before_graph, change.after_graph, changed)
            self.graphChanged.emit(changed)
        if change.selection_changed:
            self.selectionChanged.emit()
        self._keeping.look_soon()
        self.stepsChanged.emit()


def _see_each_other(occupancy: OccupancyMap, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether pairs of positions see each other on the map. The index is built on demand, because few edits need it."""
    return line_of_sight_test(occupancy)(a, b)
