"""The history of a graph, step by step, as values: undo and redo go to another step, and nothing is inverted."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any, Protocol

from nvsim.graph.delta import Delta
from nvsim.graph.edits.change import EditError
from nvsim.graph.graph_cache import GraphCache
from nvsim.graph.selection import NOTHING, GraphSelection, present
from nvsim.graph.touched import shorten
from nvsim.graph.types import EdgeKey, NavGraph

SHOWN = 8
"""Characters of an id in the name of a step."""


@dataclass(frozen=True)
class Step:
    """text       what was done, for a user
    selection  what is selected after it
    when       seconds since 1970
    edit       False for a step that only selects
    merge      steps with the same key in a row are one step: a drag
    operation  {"edit": name, ...arguments} of `nvsim.graph.operations` that leads here from the step before, where
               there is one
    outside    it leads to a graph that no edit made: a job built it, another program wrote it; `edit` is False then
    """

    text: str
    selection: GraphSelection
    when: float
    edit: bool = True
    merge: str | None = None
    operation: dict[str, Any] | None = None
    outside: bool = False

    @property
    def changes(self) -> bool:
        """Whether the graph is another one than before it."""
        return self.edit or self.outside


@dataclass(frozen=True)
class HistoryChange:
    """The graph before and after (the same object where only the selection or the list of steps changed)."""

    before_graph: NavGraph
    after_graph: NavGraph
    selection_changed: bool
    steps_changed: bool


class Recorder(Protocol):
    """Keeps a history on disk: see `nvsim.graph.journal`. `refusal` says why nothing can be edited, where that is
    so."""

    @property
    def refusal(self) -> str | None: ...

    def put(self, index: int, step: Step, delta: Delta) -> None:
        """Records step `index` (1 and up) with its delta from the step before; later steps are removed."""

    def amend(self, index: int, step: Step) -> None:
        """Replaces the selection of step `index`; all else stays."""

    def move(self, index: int, clean: int) -> None:
        """Notes the current step, and the one that is saved (-1: none)."""

    def saved(self, graph: NavGraph) -> None:
        """Notes that the file holds this graph now."""


class History:
    """Step 0 is the graph as it was opened. Every change is announced once, after it is complete."""

    def __init__(self, graph: NavGraph, journal: Recorder | None = None) -> None:
        self._steps = [Step("Opened", NOTHING, time.time(), edit=False)]
        self._graphs = GraphCache(graph)
        self._graph = graph
        self._index = 0
        self._clean = 0
        self._journal = journal
        self._listeners: list[Callable[[HistoryChange], None]] = []

    @staticmethod
    def restored(
        graphs: GraphCache, steps: list[Step], index: int, clean: int, journal: Recorder | None = None
    ) -> History:
        """A history that was written down: `graphs` knows one graph per step."""
        history = History(graphs[0], journal)
        history._steps, history._graphs, history._index, history._clean = steps, graphs, index, clean
        history._graph = graphs[index]
        return history

    # What there is ----------------------------------------------------------------------------------------------

    @property
    def graph(self) -> NavGraph:
        return self._graph

    @property
    def selection(self) -> GraphSelection:
        return self._steps[self._index].selection

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps, from the graph as it was opened to the last that can be redone."""
        return tuple(self._steps)

    @property
    def index(self) -> int:
        """The number of the current step."""
        return self._index

    @property
    def saved_index(self) -> int:
        """The number of the step whose graph was saved; -1 when it is not among the steps any more."""
        return self._clean

    @property
    def clean(self) -> bool:
        """Whether the graph is the one that was saved."""
        if self._clean < 0:
            return False
        first, last = sorted((self._clean, self._index))
        return not any(step.changes for step in self._steps[first + 1 : last + 1])

    def edits_since_saved(self) -> int:
        """How many steps that edit lie between the saved graph and the current one; all up to the current one when the
        saved graph is not among the steps."""
        first, last = sorted((max(self._clean, 0), self._index))
        return sum(step.edit for step in self._steps[first + 1 : last + 1])

    @property
    def undo_text(self) -> str | None:
        """What undo would take back; None at the beginning."""
        return self._steps[self._index].text if self._index > 0 else None

    @property
    def redo_text(self) -> str | None:
        """What redo would do again; None at the end."""
        return self._steps[self._index + 1].text if self._index + 1 < len(self._steps) else None

    def graph_at(self, index: int) -> NavGraph:
        """The graph after step `index`."""
        return self._graphs[index]

    # Doing ------------------------------------------------------------------------------------------------------

    def perform(
        self,
        text: str,
        graph: NavGraph,
        selection: GraphSelection | None = None,
        merge: str | None = None,
        operation: dict[str, Any] | None = None,
    ) -> None:
        """The graph becomes `graph`, as one step; what could be redone is gone. Without `selection` what is selected
        stays so, as far as it still exists. A step with the `merge` key of the current one takes its place; its
        operation has to lead from the graph before the first of them. Raises EditError where nothing may be edited."""
        if self._journal is not None and self._journal.refusal is not None:
            raise EditError(self._journal.refusal)
        before, was = self.graph, self.selection
        chosen = present(graph, was if selection is None else selection)
        if graph is before:
            if chosen != was:
                self.select(chosen)
            return
        merged = (
            merge is not None
            and self._index == len(self._steps) - 1
            and self._index > 0
            and self._steps[self._index].merge == merge
            and self._index != self._clean
        )
        if merged:
            earlier = self._graphs[self._index - 1]
            shorten(graph, earlier)
            self._index -= 1
        else:
            earlier = before
        self._append(Step(text, chosen, time.time(), True, merge, operation), earlier, graph)
        self._announce(before, chosen != was, True)

    def take_over(self, text: str, graph: NavGraph) -> None:
        """The file holds `graph` now, which was not made here. It becomes the current and the saved graph, as a step
        that is no edit; undo goes back to what was there before. Of several in a row the last one stays. Raises
        EditError where nothing may be edited."""
        if self._journal is not None and self._journal.refusal is not None:
            raise EditError(self._journal.refusal)
        before, was = self.graph, self.selection
        if self._index == len(self._steps) - 1 and self._steps[self._index].outside:
            self._index -= 1
        chosen = present(graph, was)
        step = Step(text, chosen, time.time(), edit=False, outside=True)
        self._append(step, self._graphs[self._index], graph)
        self._clean = self._index
        self._note()
        if self._journal is not None:
            self._journal.saved(graph)
        self._announce(before, chosen != was, True)

    def select(self, selection: GraphSelection, text: str | None = None) -> None:
        """Something else is selected, as a step. Selections in a row are one step, unless more than one thing ceases to
        be selected: what was gathered with care must not be lost by a click beside it. While something can be redone,
        the current step selects otherwise instead: a click must not cost what was undone."""
        was, graph = self.selection, self.graph
        chosen = present(graph, selection)
        if chosen == was:
            return
        current, last = self._steps[self._index], len(self._steps) - 1
        if self._index < last:
            self._steps[self._index] = replace(current, selection=chosen)
            if self._journal is not None:
                self._journal.amend(self._index, self._steps[self._index])
        else:
            lost = len(was.viewpoints - chosen.viewpoints) + len(was.edges - chosen.edges)
            if self._index > 0 and not current.changes and lost <= 1:
                self._index -= 1
            self._append(Step(text or words(chosen), chosen, time.time(), edit=False), graph, graph)
        self._announce(graph, True, True)

    def undo(self) -> bool:
        """One step back; False at the beginning."""
        return self.go_to(self._index - 1)

    def redo(self) -> bool:
        """One step forward; False at the end."""
        return self.go_to(self._index + 1)

    def go_to(self, index: int) -> bool:
        """Step `index` becomes the current one; False when there is none or it is already."""
        if not 0 <= index < len(self._steps) or index == self._index:
            return False
        before, was = self.graph, self.selection
        self._graph = self._graphs[index]
        self._index = index
        self._note()
        self._announce(before, self.selection != was, True)
        return True

    def mark_saved(self, graph: NavGraph | None = None) -> None:
        """The current graph is the one in the file; or `graph` is, which was current when the saving began."""
        at = self._index if graph is None or graph is self._graph else self._graphs.index_of(graph)
        if at is not None:
            # A step that only selects does not hold the mark: it may give way to another selection.
            at = next(i for i in range(at, -1, -1) if self._steps[i].changes or i == 0)
        self._clean = -1 if at is None else at
        self._note()
        if self._journal is not None:
            self._journal.saved(self._graph if graph is None else graph)
        self._announce(self.graph, False, True)

    # Listening --------------------------------------------------------------------------------------------------

    def listen(self, callback: Callable[[HistoryChange], None]) -> Callable[[], None]:
        """Calls back after every change; returns a function that ends it."""
        self._listeners.append(callback)

        def forget() -> None:
            if callback in self._listeners:
                self._listeners.remove(callback)

        return forget

    def _append(self, step: Step, before: NavGraph, after: NavGraph) -> None:
        self._index += 1
        if self._clean >= self._index:
            self._clean = -1
        del self._steps[self._index :]
        self._steps.append(step)
        self._graph = after
        delta = self._graphs.put(self._index, before, after)
        if self._journal is not None:
            self._journal.put(self._index, step, delta)
            self._journal.move(self._index, self._clean)

    def _note(self) -> None:
        if self._journal is not None:
            self._journal.move(self._index, self._clean)

    def _announce(self, before: NavGraph, selected: bool, steps: bool) -> None:
        change = HistoryChange(before, self._graph, selected, steps)
        for callback in tuple(self._listeners):
            callback(change)


def words(chosen: GraphSelection) -> str:
    """ "Select 3 viewpoints and edge 1a6a21cd – 2e24da71"."""
    kept = [
        named(things, thing) for things, thing in ((chosen.viewpoints, "viewpoint"), (chosen.edges, "edge")) if things
    ]
    return "Select " + (" and ".join(kept) or "nothing")


def named(things: Collection[str | EdgeKey], thing: str) -> str:
    """ "viewpoint 1a6a21cd", "edge 1a6a21cd – 2e24da71", "3 edges"."""
    if len(things) != 1:
        return counted(len(things), thing)
    (only,) = things
    ids = (only,) if isinstance(only, str) else only
    return f"{thing} {' – '.join(id[:SHOWN] for id in ids)}"


def counted(number: int, thing: str) -> str:
    """ "1 edge", "3 edges"."""
    return f"{number:,} {thing}" + ("" if number == 1 else "s")
