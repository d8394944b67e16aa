"""Other thresholds tried on the whole graph: prepared in a thread, then decided within one step of a slider."""

from __future__ import annotations

import contextlib
import threading
import time

from PySide6.QtCore import QObject, QTimer, Signal

from app.state.document import Document
from nvsim.errors import InputError
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.rethreshold import Rethreshold, Rethresholder


class ThresholdPreview(QObject):
    """Tries thresholds. changed(): `config` changed, the outcome follows. decided(): `outcome` changed."""

    changed = Signal()
    decided = Signal()
    _prepared = Signal(int, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.config = document.contents.thresholds
        self.outcome: Rethreshold | None = None
        self.refusal = ""
        """The reason why `config` cannot decide the graph: a criterion needs values that were not measured."""
        self.milliseconds = 0.0  # duration of the last decision
        self._redecider: Rethresholder | None = None
        self._number = 0
        self._thread: threading.Thread | None = None
        self._due = QTimer(self, singleShot=True, interval=0)
        self._due.timeout.connect(self._decide)
        self._prepared.connect(self._on_prepared)

    @property
    def project_config(self) -> MappingConfig:
        """The thresholds of the project's graph."""
        return self._document.contents.thresholds

    @property
    def differs(self) -> bool:
        """Whether the thresholds differ from the project's."""
        return self.config != self.project_config

    @property
    def preparing(self) -> bool:
        return self._redecider is None and self._thread is not None

    @property
    def redecider(self) -> Rethresholder | None:
        return self._redecider

    def set_config(self, config: MappingConfig) -> None:
        """Tries these thresholds. Several calls in one turn of the event loop are decided once."""
        if config == self.config:
            return
        self.config = config
        self.changed.emit()
        self.prepare()
        if self._redecider is not None:
            self._due.start()

    def prepare(self) -> None:
        """Starts to sum up the evidence in a thread, unless that is done or running."""
        graph = self._document.graph
        if graph is None or self._thread is not None or (self._redecider and self._redecider.graph is graph):
            return
        self._number += 1
        number, walk, config = self._number, self._document.trajectory.positions, self.config
        self._redecider = None

        def work() -> None:
            redecider = Rethresholder(graph, walk)
            with contextlib.suppress(InputError):  # `_decide` reports it in the main thread
                redecider.decide(config)  # computes the sums for this width of the robot
            self._prepared.emit(number, redecider)

        self._thread = threading.Thread(target=work, name="thresholds", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stops all work, and returns when it has ended."""
        self._number += 1
        self._due.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def on_graph(self, fresh: bool) -> None:
        """Drops the outcome, because the graph changed. `fresh`: it was built or opened, and has its own thresholds."""
        if fresh:
            self.config = self.project_config
        self._redecider, self.outcome, self.refusal = None, None, ""
        self._number += 1  # the running preparation is for an old graph
        self.changed.emit()
        self.decided.emit()
        if self.differs:
            self.prepare()

    def graph(self) -> NavGraph | None:
        """The graph with the edges of the outcome; None if there is no outcome."""
        if self._redecider is None or self.outcome is None:
            return None
        return self._redecider.apply(self.outcome)

    def _on_prepared(self, number: int, redecider: Rethresholder) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if number != self._number:
            if self.differs:
                self.prepare()
            return
        self._redecider = redecider
        self._decide()

    def _decide(self) -> None:
        if self._redecider is None:
            return
        begin = time.perf_counter()
        try:
            self.outcome, self.refusal = self._redecider.decide(self.config), ""
        except InputError as error:
            self.outcome, self.refusal = None, str(error)
        self.milliseconds = 1e3 * (time.perf_counter() - begin)
        self.decided.emit()
