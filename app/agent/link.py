"""The window's end of the simulator process: sends the newest walk, and restarts the process if it dies."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from PySide6.QtCore import QObject, Signal

from app.agent.child import AgentSource, Refused, Seen, Started, Walked, WalkRequest, serve
from app.agent.state import Walk, WalkedGraph
from app.drawing.pipe_process import RESTARTS, PipeProcess


class AgentLink(QObject):
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
    _heard = Signal(int, object)  # from the reading thread: number of the process, message

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._source: AgentSource | None = None
        self._child: PipeProcess | None = None
        self._number = 0  # counts processes, so that late messages of an ended process are dropped
        self._deaths = 0
        self._ready = False
        self._graph: WalkedGraph | None = None
        self._graph_known = False  # whether the process has received the graph
        self._request: WalkRequest | None = None  # the newest
        self._heard.connect(self._on_heard)

    @property
    def ready(self) -> bool:
        """Whether the process has started and answers immediately."""
        return self._ready

    @property
    def process_id(self) -> int | None:
        return None if self._child is None or self._child.process is None else self._child.process.pid

    def open(self, source: AgentSource) -> None:
        """Starts the process and ends the running one, if any. The newest request is sent again."""
        self.close()
        self._source, self._deaths = source, 0
        self._start()

    def close(self) -> None:
        """Ends the process. You can call it more than once."""
        self._number += 1
        self._ready = self._graph_known = False
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def forget(self) -> None:
        """Ends the process and discards the graph and the newest request."""
        self.close()
        self._request = self._graph = None

    def set_graph(self, graph: WalkedGraph) -> None:
        """Sets the graph of all later requests."""
        self._graph, self._graph_known = graph, False

    def ask(self, walk: Walk) -> int:
        """Requests a walk. Returns the number of the request; its answers have this number."""
        self._request = WalkRequest(1 if self._request is None else self._request.number + 1, walk)
        self._send()
        return self._request.number

    def _start(self) -> None:
        assert self._source is not None
        number = self._number
        self._child = PipeProcess(serve, self._source, "agent", lambda message: self._heard.emit(number, message))

    def _send(self) -> None:
        if self._child is None or not self._ready or self._request is None:
            return
        request = self._request if self._graph_known else replace(self._request, graph=self._graph)
        self._graph_known = True
        with contextlib.suppress(OSError):  # the reading thread reports it; the next process gets the request
            self._child.connection.send(request)

    def _on_heard(self, number: int, message: object) -> None:
        if number != self._number:
            return
        if message is None:
            self._on_death()
        elif isinstance(message, OSError | RuntimeError):
            self.close()
            self.gaveUp.emit(f"The simulator cannot be started: {message}; close other programs and try again.")
        elif isinstance(message, Started):
            self._ready = True
            self._send()
        elif isinstance(message, Walked | Refused | Seen):
            if self._request is None or message.number != self._request.number:
                return  # answers an older request
            kinds = {Walked: self.walked, Refused: self.refused, Seen: self.seen}
            kinds[type(message)].emit(message)

    def _on_death(self) -> None:
        self.close()
        self._deaths += 1
        if self._deaths > RESTARTS:
            self.gaveUp.emit("The simulator stopped repeatedly; select Graph > Walk as an agent to try again.")
            return
        self.troubled.emit("The simulator stopped and was restarted; the walk continues at the same place.")
        self._start()
