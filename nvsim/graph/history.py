"""The history of a graph, step by step, as values. Undo and redo go to another step; no edit is inverted."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from nvsim.graph.edits.change import EditError
from nvsim.graph.graph_cache import GraphCache
from nvsim.graph.selection import NOTHING, GraphSelection, existing_part
from nvsim.graph.touched_elements import shorten_note
from nvsim.graph.types import EdgeKey, NavGraph
from nvsim.plain_text import count_text

if TYPE_CHECKING:
    from nvsim.graph.journal import Journal

SHOWN = 8
"""Characters of an id in the name of a step."""


@dataclass(frozen=True)
class Step:
    """One step of a history.

    text       what was done, for users
    selection  the selection after the step
    when       seconds since 1970
    edit       False for a step that only selects
    merge      consecutive steps with equal keys become one step, for example a drag
    operation  {"edit": name, ...arguments} of `nvsim.graph.operations` that leads here from the previous step, if there
               is one
    outside    a job or another program made this graph, not an edit; `edit` is False then
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
        """Whether the step changes the graph."""
        return self.edit or self.outside


@dataclass(frozen=True)
class HistoryChange:
    """The graph before and after a change. Both are one object if only the selection or the list of steps changed."""

    before_graph: NavGraph
    after_graph: NavGraph
    selection_changed: bool


class History:
    """The steps of a graph with undo and redo. Step 0 is the opened graph. Listeners are called once for every change,
    after it is complete."""

    def __init__(self, graph: NavGraph, journal: Journal | None = None) -> None:
        self._steps = [Step("Opened", NOTHING, time.time(), edit=False)]
        self._graphs = GraphCache(graph)
        self._graph = graph
        self._index = 0
        self._clean = 0
        self._journal = journal
        self._listeners: list[Callable[[HistoryChange], None]] = []

    @staticmethod
    def restored(
        graphs: GraphCache, steps: list[Step], index: int, clean: int, journal: Journal | None = None
    ) -> History:
        """Return a history that was read from disk. `graphs` holds one graph per step."""
        history = History(graphs[0], journal)
        history._steps, history._graphs, history._index, history._clean = steps, graphs, index, clean
        history._graph = graphs[index]
        return history

    # State -----------------------------------------------------------------------------------------------------

    @property
    def graph(self) -> NavGraph:
        """The graph after the current step."""
        return self._graph

    @property
    def selection(self) -> GraphSelection:
        """The viewpoints and edges that are selected at the current step."""
        return self._steps[self._index].selection

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps, from the opened graph to the last step that can be redone."""
        return tuple(self._steps)

    @property
    def index(self) -> int:
        """The number of the current step."""
        return self._index

    @property
    def saved_index(self) -> int:
        """The number of the step whose graph was saved; -1 if the history does not contain it."""
        return self._clean

    @property
    def is_saved(self) -> bool:
        """Whether the current graph is the saved one."""
        if self._clean < 0:
            return False
        first, last = sorted((self._clean, self._index))
        return not any(step.changes for step in self._steps[first + 1 : last + 1])

    def edits_since_saved(self) -> int:
        """Return the number of edit steps between the saved and the current graph. If the history does not contain the
        saved graph, all edit steps up to the current one count."""
        first, last = sorted((max(self._clean, 0), self._index))
        return sum(step.edit for step in self._steps[first + 1 : last + 1])

    @property
    def undo_text(self) -> str | None:
        """The text of the step that undo reverts; None at the beginning."""
        return self._steps[self._index].text if self._index > 0 else None

    @property
    def redo_text(self) -> str | None:
        """The text of the step that redo repeats; None at the end."""
        return self._steps[self._index + 1].text if self._index + 1 < len(self._steps) else None

    def graph_at(self, index: int) -> NavGraph:
        """The graph after step `index`."""
        return self._graphs[index]

    # Changes ----------------------------------------------------------------------------------------------------

    def perform(
        self,
        text: str,
        graph: NavGraph,
        selection: GraphSelection | None = None,
        merge: str | None = None,
        operation: dict[str, Any] | None = None,
    ) -> None:
        """Make `graph` the current graph, as one step. Steps that could be redone are deleted.

        Without `selection`, the selection stays, except for elements that do not exist in `graph`. A step replaces the
        current step if both have the same `merge` key; its `operation` must then start from the graph before the first
        of these steps. Raises EditError if editing is not allowed.
        """
        if self._journal is not None and self._journal.refusal is not None:
            raise EditError(self._journal.refusal)
        before, was = self.graph, self.selection
        chosen = existing_part(graph, was if selection is None else selection)
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
            shorten_note(graph, earlier)
            self._index -= 1
        else:
            earlier = before
        self._append(Step(text, chosen, time.time(), True, merge, operation), earlier, graph)
        self._announce(before, chosen != was)

    def replace_from_outside(self, text: str, graph: NavGraph) -> None:
        """Make `graph`, which a job or another program wrote to the file, the current and saved graph. It becomes a
        step that is not an edit, and undo returns to the previous graph. Of several such steps in a row, only the last
        is kept.

        Raises EditError if editing is not allowed.
        """
        if self._journal is not None and self._journal.refusal is not None:
            raise EditError(self._journal.refusal)
        before, was = self.graph, self.selection
        if self._index == len(self._steps) - 1 and self._steps[self._index].outside:
            self._index -= 1
        chosen = existing_part(graph, was)
        step = Step(text, chosen, time.time(), edit=False, outside=True)
        self._append(step, self._graphs[self._index], graph)
        self._clean = self._index
        self._note()
        if self._journal is not None:
            self._journal.saved(graph)
        self._announce(before, chosen != was)

    def select(self, selection: GraphSelection, text: str | None = None) -> None:
        """Change the selection, as a step.

        Consecutive selections become one step unless more than one element is deselected: a wrong click must not lose a
        careful selection. If there are steps to redo, the selection of the current step is replaced, so that these
        steps are kept.
        """
        was, graph = self.selection, self.graph
        chosen = existing_part(graph, selection)
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
            self._append(Step(text or selection_text(chosen), chosen, time.time(), edit=False), graph, graph)
        self._announce(graph, True)

    def undo(self) -> bool:
        """Go one step back. Returns False at the beginning."""
        return self.go_to(self._index - 1)

    def redo(self) -> bool:
        """Go one step forward. Returns False at the end."""
        return self.go_to(self._index + 1)

    def go_to(self, index: int) -> bool:
        """Make step `index` the current one. Returns False if it does not exist or is the current one already."""
        if not 0 <= index < len(self._steps) or index == self._index:
            return False
        before, was = self.graph, self.selection
        self._graph = self._graphs[index]
        self._index = index
        self._note()
        self._announce(before, self.selection != was)
        return True

    def mark_saved(self, graph: NavGraph | None = None) -> None:
        """Record that the file holds the current graph, or `graph`, which was current when saving began."""
        at = self._index if graph is None or graph is self._graph else self._graphs.index_of(graph)
        if at is not None:
            # Do not mark a step that only selects, because another selection may replace it.
            at = next(i for i in range(at, -1, -1) if self._steps[i].changes or i == 0)
        self._clean = -1 if at is None else at
        self._note()
        if self._journal is not None:
            self._journal.saved(self._graph if graph is None else graph)
        self._announce(self.graph, False)

    # Listeners --------------------------------------------------------------------------------------------------

    def listen(self, callback: Callable[[HistoryChange], None]) -> Callable[[], None]:
        """Call `callback` after every change. Returns a function that removes the callback."""
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
        delta = self._graphs.store_step(self._index, before, after)
        if self._journal is not None:
            self._journal.record_step(self._index, step, delta)
            self._journal.move(self._index, self._clean)

    def _note(self) -> None:
        if self._journal is not None:
            self._journal.move(self._index, self._clean)

    def _announce(self, before: NavGraph, selected: bool) -> None:
        change = HistoryChange(before, self._graph, selected)
        for callback in tuple(self._listeners):
            callback(change)


def selection_text(chosen: GraphSelection) -> str:
    """Return the text of a selection step: "Select 3 viewpoints and edge 1a6a21cd – 2e24da71"."""
    kept = [
        name_or_count(things, thing)
        for things, thing in ((chosen.viewpoints, "viewpoint"), (chosen.edges, "edge"))
        if things
    ]
    return "Select " + (" and ".join(kept) or "nothing")


def name_or_count(things: Collection[str | EdgeKey], thing: str) -> str:
    """Name one element or count several: "viewpoint 1a6a21cd", "edge 1a6a21cd – 2e24da71", "3 edges"."""
    if len(things) != 1:
        return count_text(len(things), thing)
    (only,) = things
    ids = (only,) if isinstance(only, str) else only
    return f"{thing} {' – '.join(id[:SHOWN] for id in ids)}"
