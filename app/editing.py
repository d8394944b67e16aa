"""The graph while it is edited: its history, what is selected in it, what is wrong with it, and where it is saved.

The history holds values (nvsim.graph.history), so undo, redo and a jump to any step are one assignment here. Everybody
who shows the graph hears of the difference.
"""

from __future__ import annotations

import gc
import threading
import uuid
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from app.checking import Checking
from app.graph_files import GraphFile
from app.proposals import Proposals
from nvsim.errors import InputError
from nvsim.graph.difference import difference
from nvsim.graph.edits import EditError, new_id
from nvsim.graph.findings import Finding
from nvsim.graph.history import History, HistoryChange
from nvsim.graph.journal import Journal
from nvsim.graph.operations import Surroundings, apply, describe, record
from nvsim.graph.review import Review
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.graph.sight import sight_on
from nvsim.graph.types import NavGraph
from nvsim.mapping.against import margin
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.types import OccupancyMap

LOOK = 1200  # milliseconds after a step until it must be on the disk
LARGE = 2000  # viewpoints from which on Python's collector is felt
EYE = 1.5  # metres above the floor, of a viewpoint that nobody gave another height

Place = tuple[float, float, float]


class Editing(QObject):
    """graphChanged(Difference); selectionChanged(); stepsChanged() when there are other steps, another one is current,
    or what is saved changed; findingsChanged(); refused(str): why an edit did not happen; told(str) what a person may
    want to know; failed(str): what could not be read or written."""

    graphChanged = Signal(object)
    selectionChanged = Signal()
    stepsChanged = Signal()
    findingsChanged = Signal()
    refused = Signal(str)
    told = Signal(str)
    failed = Signal(str)
    _saved = Signal(object, str)  # from the thread that saves: the history it belongs to, what went wrong

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.history: History | None = None
        self.file: GraphFile | None = None
        self.proposals = Proposals()
        self.locked = ""
        """Why nothing can be changed here, "" when it can: another window edits the same graph."""
        self.checking = Checking(self, self.findingsChanged.emit)
        self.saving = False
        self._journal: Journal | None = None
        self._thresholds = MappingConfig()
        self.review = Review(margin(self._thresholds))
        """The order in which a person looks at edges."""
        self._surroundings = Surroundings()
        self._saver: threading.Thread | None = None
        self._trouble = ""
        self._disk = QTimer(self, singleShot=True, interval=LOOK)
        self._disk.timeout.connect(self._look_at_disk)
        self._saved.connect(self._on_saved)

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

    @property
    def eye_height(self) -> float:
        """Metres above the floor at which a new viewpoint stands: as the others do."""
        graph = self.graph
        if graph is None or not graph.viewpoints:
            return EYE
        some = [v.height for v, _ in zip(graph.viewpoints.values(), range(99), strict=False)]
        return sorted(some)[len(some) // 2]

    # Opening and closing -----------------------------------------------------------------------------------------

    def open(self, graph: NavGraph | None, file: GraphFile | None) -> None:
        """Edits `graph` from now on; edits of an earlier window that were not saved come back. When the same file was
        read again, what it now holds becomes a step."""
        if self.history is not None and graph is not None and file is not None and file is self.file:
            self._take_over(graph)
            return
        self.close()
        self.file = file
        if graph is not None:
            self.history = self._opened(graph, file)
            self.history.listen(self._on_change)
            self.checking.look_soon(graph, file)
            if len(graph.viewpoints) > LARGE:
                # What was opened stays: the collector need not walk through all of it in the middle of an edit.
                gc.collect()
                gc.freeze()
        self.selectionChanged.emit()
        self.stepsChanged.emit()

    def _opened(self, graph: NavGraph, file: GraphFile | None) -> History:
        """The history as it was left, going on from what the file holds."""
        if file is None or file.journal is None:
            return History(graph)
        try:
            self._journal = Journal.open(file.journal, plain=file.foreign)
            history = self._journal.history(graph)
        except InputError as error:
            self._journal = None
            self.failed.emit(f"{error} Edits will not survive a crash.")
            return History(graph)
        self.locked = self._journal.refusal or ""
        if self._journal.notice:
            self.told.emit(self._journal.notice)
        if self._journal.recovered:
            edits = _counted(self._journal.recovered, "edit")
            self.told.emit(f"{edits} that were not saved came back; the history shows them, and undo takes them back.")
        return history

    def _take_over(self, graph: NavGraph) -> None:
        """The project holds another graph: a job built it."""
        assert self.history is not None  # asked before
        if self.history.clean:
            self.history.perform("Take what the project holds now", graph)
            self.history.mark_saved()
        else:
            self.told.emit(
                "The graph of the project was built again while you edit; yours is kept, and saving replaces the "
                "built one. Compare shows the two."
            )

    def close(self) -> None:
        """What was edited is on the disk when this returns."""
        if self._saver is not None:
            self._saver.join()
        if self._journal is not None:
            try:
                self._journal.close()
            except InputError as error:
                self.failed.emit(str(error))
        self.history, self.file, self._journal, self.locked = None, None, None, ""
        self.checking.forget()

    def _look_at_disk(self) -> None:
        """The journal writes by itself; what it cannot write is said once."""
        trouble = "" if self._journal is None else self._journal.trouble
        if trouble and trouble != self._trouble:
            self.failed.emit(trouble)
        self._trouble = trouble

    # Saving ------------------------------------------------------------------------------------------------------

    def save(self, wait: bool = False) -> None:
        """Writes the graph to the project or back to its file, in a thread; `wait` returns when it is written."""
        history, file = self.history, self.file
        if history is None or file is None or not self.writable or self.saving:
            return
        graph, journal = history.graph, self._journal
        self.saving = True

        def work() -> None:
            trouble = ""
            try:
                if journal is not None:
                    journal.flush()  # so that after a crash the journal knows what the file holds
                file.save(graph)
            except InputError as error:
                trouble = str(error)
            self._saved.emit((history, graph), trouble)

        self._saver = threading.Thread(target=work, name="graph saver")
        self._saver.start()
        if wait:
            self._saver.join()

    def _on_saved(self, what: tuple[History, NavGraph], trouble: str) -> None:
        history, graph = what
        self.saving = False
        if trouble:
            self.failed.emit(trouble)
        elif history is self.history:
            history.mark_saved(graph)
            if not history.clean:
                self.told.emit("Saved as it was when saving began; what came after is not saved yet.")

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

    # What a hand does ----------------------------------------------------------------------------------------------

    def add_viewpoint(self, position: Place, join: str | None = None) -> None:
        """A viewpoint whose camera stands at `position`, joined to another where one is named."""
        if self.graph is None:
            return
        id = new_id(self.graph, position)
        steps: list[tuple[str, dict[str, Any]]] = [
            ("add_viewpoint", {"position": list(position), "height": self.eye_height, "id": id})
        ]
        if join is not None:
            steps.append(("add_edges", {"pairs": [[join, id]]}))
        words = "Add a viewpoint and join it" if join is not None else ""
        self.run_all(steps, words, selection=GraphSelection(frozenset({id})))

    def add_viewpoint_on_floor(self, foot: Place, join: str | None = None) -> None:
        """A viewpoint that stands on the floor at `foot`, as high as the others."""
        x, y, z = foot
        self.add_viewpoint((x, y, z + self.eye_height), join)

    def split_edge(self, edge: tuple[str, str], share: float) -> None:
        """A viewpoint on the edge, that far along it; the edge becomes two."""
        graph = self.graph
        if graph is None or any(end not in graph.viewpoints for end in edge):
            return
        a, b = (graph.viewpoints[end].position for end in edge)
        x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
        id = new_id(graph, (x, y, z))
        arguments = {"edge": list(edge), "share": share, "id": id}
        self.run("split_edge", arguments, selection=GraphSelection(frozenset({id})))

    def add_edge(self, a: str, b: str) -> None:
        """The edge is selected afterwards."""
        key = (min(a, b), max(a, b))
        self.run("add_edges", {"pairs": [[a, b]]}, selection=GraphSelection(frozenset(), frozenset({key})))

    def move(self, ids: Iterable[str], offset: Place, merge: str | None = None) -> None:
        """All of them by the same metres. With a merge key a series of moves is one step."""
        self.run("shift_viewpoints", {"ids": list(ids), "by": list(offset)}, merge=merge)

    def remove_selection(self) -> None:
        """The selected viewpoints with their edges, and the selected edges."""
        graph, chosen = self.graph, self.selection
        if graph is None:
            return
        edges = sorted(key for key in chosen.edges if not chosen.viewpoints.intersection(key))
        steps: list[tuple[str, dict[str, Any]]] = []
        if chosen.viewpoints:
            steps.append(("remove_viewpoints", {"ids": [id for id in graph.viewpoints if id in chosen.viewpoints]}))
        if edges:
            steps.append(("remove_edges", {"pairs": [list(key) for key in edges]}))
        if steps:
            words = f"Remove {_counted(len(chosen.viewpoints), 'viewpoint')} and {_counted(len(edges), 'edge')}"
            self.run_all(steps, words if len(steps) > 1 else "", selection=NOTHING)

    # What is wrong with it ---------------------------------------------------------------------------------------

    def set_surroundings(self, occupancy: OccupancyMap | None, trajectory: NDArray[np.float64] | None) -> None:
        """What the graph is checked against, and what edits may need: (N, 3) the places of the frames."""
        visible = None if occupancy is None else partial(_see_each_other, occupancy)
        self._surroundings = Surroundings(visible, trajectory)
        self.checking.set_occupancy(occupancy)

    def set_thresholds(self, config: MappingConfig) -> None:
        """What evidence is held against."""
        if config == self._thresholds:
            return
        self._thresholds, self.review = config, Review(margin(config))
        self.checking.set_thresholds(config)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """What is wrong with the graph, by key; what a person ignores is among them."""
        return self.checking.findings

    def ignore_finding(self, finding: Finding, reason: str) -> None:
        """It is not shown again."""
        self.run("ignore_finding", {"key": finding.key, "reason": reason})

    def heed_finding(self, finding: Finding) -> None:
        """It is shown again."""
        self.run("heed_finding", {"key": finding.key})

    # What follows from a step --------------------------------------------------------------------------------------

    def _on_change(self, change: HistoryChange) -> None:
        if change.before_graph is not change.after_graph:
            changed = difference(change.before_graph, change.after_graph)
            self.checking.follow(change.before_graph, change.after_graph, changed)
            self.graphChanged.emit(changed)
        if change.selection_changed:
            self.selectionChanged.emit()
        if change.steps_changed:
            self._disk.start()
            self.stepsChanged.emit()


def _see_each_other(occupancy: OccupancyMap, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Made when asked: few edits need it."""
    return sight_on(occupancy)(a, b)


def _counted(number: int, thing: str) -> str:
    return f"{number:,} {thing}" + ("" if number == 1 else "s")
