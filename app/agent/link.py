"""The window's end of the simulator process."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from app.agent.child import Refused, Seen, Walked, WalkRequest, serve
from app.agent.state import Walk, WalkedGraph
from app.processes.child import RESTARTS, Program
from app.processes.side_process import SideProcess

_PROGRAM = Program(
    serve,
    "agent",
    "The walk cannot be simulated",
    "close other programs and try again",
    "The simulator stopped repeatedly; select Graph > Walk as an agent to try again.",
    RESTARTS,
)


class AgentLink(SideProcess):
    """Sends walks to the simulator process and emits its answers.

    walked(Walked), refused(Refused)   the answer to the newest walk; answers to older walks are dropped
    seen(Seen)                         the image of the newest walk, after `walked`
    troubled(str)                      the process stopped and was restarted
    gaveUp(str)                        the process stopped and will not be restarted
    """

    walked = Signal(object)
    refused = Signal(object)
    seen = Signal(object)
    troubled = Signal(str)
    gaveUp = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_PROGRAM, parent)
        self.heard.connect(self._on_heard)
        self.restarted.connect(self._on_restart)
        self.ended.connect(lambda end: self.gaveUp.emit(end.sentence))
        self._graph: WalkedGraph | None = None
        self._unknown_since = 0  # number of the first request since the graph was set or the process started
        self._known = False  # whether the process answered one of these requests, so that it has the graph
        self._walk: Walk | None = None  # the newest
        self._requested = 0

    def open(self, source: object) -> None:
        """Starts the process on an AgentSource, and ends the running one. The newest walk is sent again."""
        super().open(source)
        self._ask_again()

    def forget(self) -> None:
        """Ends the process and discards the graph and the newest walk."""
        self.close()
        self.cancel(WalkRequest)
        self._walk = self._graph = None

    def set_graph(self, graph: WalkedGraph) -> None:
        """Sets the graph of all later requests."""
        self._graph, self._known, self._unknown_since = graph, False, self._requested + 1

    def ask_walk(self, walk: Walk) -> None:
        """Requests a walk."""
        self._walk = walk
        self._requested += 1
        self.ask(WalkRequest(self._requested, walk, None if self._known else self._graph))

    def _ask_again(self) -> None:
        """Repeats the newest walk in a new process, which does not have the graph."""
        if self._graph is not None:
            self.set_graph(self._graph)
        if self._walk is not None:
            self.ask_walk(self._walk)

    def _on_heard(self, message: object) -> None:
        assert isinstance(message, Walked | Refused | Seen)
        self._known = self._known or message.number >= self._unknown_since
        if message.number == self._requested:
            kinds = {Walked: self.walked, Refused: self.refused, Seen: self.seen}
            kinds[type(message)].emit(message)

    def _on_restart(self) -> None:
        self.troubled.emit("The simulator stopped and was restarted; the walk continues at the same place.")
        self._ask_again()
