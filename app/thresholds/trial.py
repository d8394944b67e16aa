"""Other thresholds on the whole graph: prepared in a thread, decided in the window's own within a slider's step."""

from __future__ import annotations

import contextlib
import threading
import time

from PySide6.QtCore import QObject, QTimer, Signal

from app.state.document import Document
from nvsim.errors import InputError
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.rethreshold import Rethreshold, Rethresholder


class Trial(QObject):
    """changed(): `config` is another, and what it leads to follows; decided(): `outcome` is another."""

    changed = Signal()
    decided = Signal()
    _prepared = Signal(int, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.config = document.contents.thresholds
        self.outcome: Rethreshold | None = None
        self.refusal = ""
        """Why the graph cannot be decided by `config`: what a criterion asks for was not measured."""
        self.milliseconds = 0.0  # that the last decision took
        self._redecider: Rethresholder | None = None
        self._number = 0
        self._thread: threading.Thread | None = None
        self._due = QTimer(self, singleShot=True, interval=0)
        self._due.timeout.connect(self._decide)
        self._prepared.connect(self._on_prepared)

    @property
    def project_config(self) -> MappingConfig:
        """What the project's graph was decided with."""
        return self._document.contents.thresholds

    @property
    def differs(self) -> bool:
        """Whether other thresholds than the project's are tried."""
        return self.config != self.project_config

    @property
    def preparing(self) -> bool:
        return self._redecider is None and self._thread is not None

    @property
    def redecider(self) -> Rethresholder | None:
        return self._redecider

    def set_config(self, config: MappingConfig) -> None:
        """Tries these; several in one turn of the event loop are decided once."""
        if config == self.config:
            return
        self.config = config
        self.changed.emit()
        self.prepare()
        if self._redecider is not None:
            self._due.start()

    def prepare(self) -> None:
        """Sums the evidence up, unless that is done or under way."""
        graph = self._document.graph
        if graph is None or self._thread is not None or (self._redecider and self._redecider.graph is graph):
            return
        self._number += 1
        number, walk, config = self._number, self._document.trajectory.positions, self.config
        self._redecider = None

        def work() -> None:
            redecider = Rethresholder(graph, walk)
            with contextlib.suppress(InputError):  # said when it is decided in the window's own thread
                redecider.decide(config)  # the sums for this width of the robot are made here
            self._prepared.emit(number, redecider)

        self._thread = threading.Thread(target=work, name="thresholds", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Nothing runs when this returns."""
        self._number += 1
        self._due.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def on_graph(self, fresh: bool) -> None:
        """Another graph is shown. `fresh`: one that was built or opened, with thresholds of its own."""
        if fresh:
            self.config = self.project_config
        self._redecider, self.outcome, self.refusal = None, None, ""
        self._number += 1  # what is under way is about a graph of the past
        self.changed.emit()
        self.decided.emit()
        if self.differs:
            self.prepare()

    def graph(self) -> NavGraph | None:
        """The graph with the edges of the outcome; None while there is none."""
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
