"""What is wrong with the graph that is edited: looked for in slices while a user goes on, then followed from edit to
edit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QObject, QTimer

from app.state.graph_files import GraphFile
from nvsim.graph.difference import Difference
from nvsim.graph.findings import Context, Finding, Validator
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.edge_doubts import against
from nvsim.mapping.unmeasured import closed

LARGE = 1000  # edges, from which on the window goes on while they are looked at
SLICE = 0.008  # seconds of that at a time
AT_ONCE = 1e9


@dataclass
class _Look:
    """A look at a whole graph that is under way."""

    graph: NavGraph
    validator: Validator
    steps: Iterator[None]


class Checking:
    """Calls `changed` when other things are wrong. Its timers are children of `parent`."""

    def __init__(self, parent: QObject, changed: Callable[[], object]) -> None:
        self._changed = changed
        self._graph: NavGraph | None = None
        self._file: GraphFile | None = None
        self._known = Context(against=against(MappingConfig()), closed=closed(MappingConfig()))
        self._validator: Validator | None = None
        self._look: _Look | None = None
        self._begin = QTimer(parent, singleShot=True, interval=0)
        self._begin.timeout.connect(self.look)
        self._slices = QTimer(parent, singleShot=True, interval=2)
        self._slices.timeout.connect(self._go_on)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """By key; what a user ignores is among them."""
        return {} if self._validator is None else self._validator.findings

    def set_context(self, known: Context) -> None:
        """What the graph is held against, as far as it is known; its file may add to it."""
        if known is not self._known:
            self._known = known
            self._look_again()

    def look_soon(self, graph: NavGraph | None, file: GraphFile | None) -> None:
        """Looks at the whole graph once the event loop comes round: several reasons to do so come together."""
        self._graph, self._file = graph, file
        self._validator, self._look = None, None
        self._begin.start()

    def _look_again(self) -> None:
        if self._graph is not None:
            self.look_soon(self._graph, self._file)

    def forget(self) -> None:
        """No graph is looked at, and nothing is said any more."""
        self._graph, self._file, self._validator, self._look = None, None, None, None
        self._begin.stop()
        self._slices.stop()

    def look(self) -> None:
        """Looks at the whole graph, a large one while the user goes on."""
        graph = self._graph
        context = self._known if self._file is None else self._file.context(self._known)
        self._validator, self._look = None, None
        if graph is None:
            self._changed()
            return
        validator = Validator()
        self._look = _Look(graph, validator, validator.beginning(graph, context))
        self._go_on(AT_ONCE if len(graph.edges) < LARGE else SLICE)

    def follow(self, before: NavGraph, after: NavGraph, changed: Difference) -> None:
        """The graph was edited."""
        self._graph = after
        if self._validator is not None:
            came, gone = self._validator.update(after, changed)
            if came or gone or before.ignored is not after.ignored:
                self._changed()

    def _go_on(self, seconds: float = SLICE) -> None:
        look = self._look
        if look is None:
            return
        if look.graph is not self._graph:
            self._look_again()  # it was edited meanwhile
            return
        until = time.perf_counter() + seconds
        for _ in look.steps:
            if time.perf_counter() > until:
                self._slices.start()
                return
        self._validator, self._look = look.validator, None
        self._changed()
