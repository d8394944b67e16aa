"""The graph while it is edited: its history, what is selected in it and what is wrong with it.

The history holds values (nvsim.graph.history), so undo, redo and a jump to any step are one assignment here. Everybody
who shows the graph hears of the difference.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from app.state.checking import Checking
from app.state.graph_files import GraphFile
from app.state.graph_saving import Keeping
from app.state.proposals import Proposals
from nvsim.graph.difference import difference
from nvsim.graph.edits import EditError, Visible
from nvsim.graph.findings import Finding
from nvsim.graph.history import History, HistoryChange
from nvsim.graph.operations import EditContext, apply, describe, record
from nvsim.graph.review import Review
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.graph.sight import sight_on
from nvsim.graph.store import same_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.edge_doubts import margin
from nvsim.occupancy.types import OccupancyMap


class Editing(QObject):
    """graphChanged(Difference); selectionChanged(); stepsChanged() when there are other steps, another one is current,
    or what is saved changed; findingsChanged(); refused(str): why an edit did not happen; told(str) what a user may
    want to know; failed(str): what could not be read or written."""

    graphChanged = Signal(object)
    selectionChanged = Signal()
    stepsChanged = Signal()
    findingsChanged = Signal()
    refused = Signal(str)
    told = Signal(str)
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.history: History | None = None
        self.file: GraphFile | None = None
        self.proposals = Proposals()
        self.locked = ""
        """Why nothing can be changed here, "" when it can: another window edits the same graph."""
        self.checking = Checking(self, self.findingsChanged.emit)
        self._thresholds = MappingConfig()
        self.review = Review(margin(self._thresholds))
        """The order in which a user looks at edges."""
        self._surroundings = EditContext()
        self._keeping = Keeping(self)
        self._keeping.told.connect(self.told)
        self._keeping.failed.connect(self.failed)

    # What there is -----------------------------------------------------------------------------------------------

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
        """Whether there are edits that the project or the file does not hold yet."""
        return self.history is not None and not self.history.clean

    # Opening and closing -----------------------------------------------------------------------------------------

    def open(self, graph: NavGraph | None, file: GraphFile | None) -> None:
        """Edits `graph` from now on; edits of an earlier window that were not saved come back. When the same file was
        read again and holds another graph, that becomes a step which is no edit."""
        again = self.history is not None and graph is not None and file is not None and file is self.file
        if again and graph is not None and self._take_over(graph):
            return
        self.close()
        self.file = file
        if graph is not None:
            self.history, self.locked = self._keeping.open(graph, file)
            self.history.listen(self._on_change)
            self.checking.look_soon(graph, file)
        self.selectionChanged.emit()
        self.stepsChanged.emit()

    def _take_over(self, graph: NavGraph) -> bool:
        """The project was read again. Most often it holds what it held, as a stage that began or ended is reason enough
        to read; otherwise a job built another graph. False where it has to be opened anew."""
        assert self.history is not None  # asked before
        held = self.history.graph_at(self.history.saved_index) if self.history.saved_index >= 0 else None
        if held is not None and same_graph(held, graph):
            return True
        if self.locked:
            return False
        if self.history.clean:
            self.history.take_over("Map built again by a job", graph)
        else:
            self.told.emit(
                "The graph of the project was built again while you edit. You still edit yours; saving replaces the "
                "built one. Compare shows the two."
            )
        return True

    def close(self) -> None:
        """What was edited is on the disk when this returns."""
        self._keeping.close()
        self.history, self.file, self.locked = None, None, ""
        self.checking.forget()

    def save(self, wait: bool = False) -> None:
        """Writes the graph to the project or back to its file, in a thread; `wait` returns when it is written."""
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
        """One operation of nvsim.graph.operations as one step. Returns whether it happened; if not, says why."""
        return self.run_all([(name, arguments)], selection=selection, merge=merge)

    def perform(self, text: str, graph: NavGraph) -> bool:
        """A graph that was made elsewhere, as one step. Returns whether it happened; if not, says why."""
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
    ) -> bool:
        """Several operations, one after another, as one step; none happens when one is refused."""
        if self.history is None or not self.writable:
            self.refuse(self.locked or "No navigation graph is open.")
            return False
        graph, done = self.history.graph, []
        try:
            for name, arguments in operations:
                graph = apply(graph, name, arguments, self._surroundings)
                done.append((name, arguments))
            words = text or describe(*done[-1])
        except EditError as error:
            self.refuse(str(error))
            return False
        if graph is self.history.graph:
            self.refuse("Nothing would change: it is so already.")
            return False
        # A key of its own lets what is measured later become part of the step.
        key = merge or uuid.uuid4().hex
        if len(done) == 1:
            line = record(*done[0])
        else:
            line = record("together", {"edits": [record(*each) for each in done], "text": words})
        self.history.perform(words, graph, selection, key, line)
        return True

    def amend(self, text: str, graph: NavGraph) -> None:
        """The graph becomes `graph`, as part of the last edit where that is the current step, else as a step."""
        if self.history is None or not self.writable:
            return
        last = self.history.steps[self.history.index]
        if last.edit and last.merge is not None:
            self.history.perform(last.text, graph, None, last.merge, last.operation)
        else:
            self.history.perform(text, graph)

    def refuse(self, sentence: str) -> None:
        """Says why nothing happened."""
        self.refused.emit(sentence)

    def select(self, selection: GraphSelection) -> None:
        """Selects these instead; one can undo it."""
        if self.history is not None:
            self.history.select(selection)

    def undo(self) -> None:
        if self.history is not None and self.writable:
            self.history.undo()

    def redo(self) -> None:
        if self.history is not None and self.writable:
            self.history.redo()

    def go_to(self, index: int) -> None:
        """To the graph after so many steps."""
        if self.history is not None and self.writable:
            self.history.go_to(index)

    # What is wrong with it ---------------------------------------------------------------------------------------

    def set_surroundings(self, occupancy: OccupancyMap | None, trajectory: NDArray[np.float64] | None) -> None:
        """What edits may need: a map, and (N, 3) the places of the frames."""
        visible: Visible | None = None
        if occupancy is not None:
            visible = partial(_see_each_other, occupancy)
        elif self.file is not None:
            visible = self.file.sight()
        self._surroundings = EditContext(visible, trajectory)

    def set_thresholds(self, config: MappingConfig) -> None:
        """The thresholds that the review compares evidence with."""
        if config == self._thresholds:
            return
        self._thresholds, self.review = config, Review(margin(config))

    @property
    def findings(self) -> Mapping[str, Finding]:
        """What is wrong with the graph, by key; what a user ignores is among them."""
        return self.checking.findings

    def ignore_finding(self, finding: Finding, reason: str) -> None:
        """It is not shown again."""
        self.ignore(finding.key, reason)

    def heed_finding(self, finding: Finding) -> None:
        """It is shown again."""
        self.heed(finding.key)

    def ignore(self, key: str, reason: str) -> None:
        """The findings of this key, of one or of a kind, are not shown again."""
        self.run("ignore_finding", {"key": key, "reason": reason})

    def heed(self, key: str) -> None:
        """They are shown again."""
        self.run("heed_finding", {"key": key})

    # What follows from a step --------------------------------------------------------------------------------------

    def _on_change(self, change: HistoryChange) -> None:
        if change.before_graph is not change.after_graph:
            changed = difference(change.before_graph, change.after_graph)
            self.checking.follow(change.before_graph, change.after_graph, changed)
            self.graphChanged.emit(changed)
        if change.selection_changed:
            self.selectionChanged.emit()
        if change.steps_changed:
            self._keeping.look_soon()
            self.stepsChanged.emit()


def _see_each_other(occupancy: OccupancyMap, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Made when asked: few edits need it."""
    return sight_on(occupancy)(a, b)
