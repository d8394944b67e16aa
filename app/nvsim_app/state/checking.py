"""Validates the edited graph: first the whole graph in time slices, then incrementally after each edit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QObject, QTimer

from nvsim.graph.difference import Difference
from nvsim.graph.findings import Context, Finding, Validator
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.explain import closed_edge_reason, closed_path_test
from nvsim_app.state.graph_files import GraphFile

LARGE = 1000  # number of edges from which the graph is validated in slices
SLICE = 0.008  # duration of a slice, seconds
AT_ONCE = 1e9


@dataclass
class _PendingValidation:
    """A validation of a whole graph in progress."""

    graph: NavGraph
    validator: Validator
    steps: Iterator[None]


class Checking:
    """Keeps the findings of the edited graph up to date. Calls `changed` when the findings changed or became unknown.
    Its timers are children of `parent`."""

    def __init__(self, parent: QObject, changed: Callable[[], object]) -> None:
        self._changed = changed
        self._graph: NavGraph | None = None
        self._file: GraphFile | None = None
        self._known = Context(against=closed_edge_reason(MappingConfig()), closed=closed_path_test(MappingConfig()))
        self._validator: Validator | None = None
        self._look: _PendingValidation | None = None
        self._begin = QTimer(parent, singleShot=True, interval=0)
        self._begin.timeout.connect(self.validate)
        self._slices = QTimer(parent, singleShot=True, interval=2)
        self._slices.timeout.connect(self._go_on)

    @property
    def complete(self) -> bool:
        """Whether `findings` are all findings of the graph. Until then there are none."""
        return self._graph is None or self._validator is not None

    @property
    def findings(self) -> Mapping[str, Finding]:
        """The findings by key, including those that the user ignores."""
        return {} if self._validator is None else self._validator.findings

    def set_context(self, known: Context) -> None:
        """Sets the context of the validation. The graph's file may add to it."""
        if known is not self._known:
            self._known = known
            self.validate_again()

    def schedule_validation(self, graph: NavGraph | None, file: GraphFile | None) -> None:
        """Schedules a validation of the whole graph in the next iteration of the event loop, so that several requests
        are merged."""
        self._graph, self._file = graph, file
        self._validator, self._look = None, None
        self._begin.start()
        self._changed()

    def validate_again(self) -> None:
        """Validates the whole graph again, if there is one."""
        if self._graph is not None:
            self.schedule_validation(self._graph, self._file)

    def reset(self) -> None:
        """Stops the validation and drops the graph and its findings."""
        self._graph, self._file, self._validator, self._look = None, None, None, None
        self._begin.stop()
        self._slices.stop()
        self._changed()

    def validate(self) -> None:
        """Validates the whole graph. A large graph is validated in slices, so that the window stays responsive."""
        graph = self._graph
        context = self._known if self._file is None else self._file.context(self._known)
        self._validator, self._look = None, None
        if graph is None:
            self._changed()
            return
        validator = Validator()
        self._look = _PendingValidation(graph, validator, validator.beginning(graph, context))
        self._go_on(AT_ONCE if len(graph.edges) < LARGE else SLICE)

    def update(self, before: NavGraph, after: NavGraph, changed: Difference) -> None:
        """Updates the findings after an edit."""
        self._graph = after
        if self._validator is not None:
            came, gone = self._validator.update(after, changed)
            if came or gone or before.ignored is not after.ignored:
                self._changed()

    def _go_on(self, seconds: float = SLICE) -> None:
        look = self._look
        if look is None:
            return
        until = time.perf_counter() + seconds
        for _ in look.steps:
            if time.perf_counter() > until:
                self._slices.start()
                return
        if self._graph is not None and look.graph is not self._graph:
            look.validator.update(self._graph)  # the graph was edited meanwhile
        self._validator, self._look = look.validator, None
        self._changed()
