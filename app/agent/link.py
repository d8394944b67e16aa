"""The window's end of the simulator's process: asks for the newest walk, starts the process again when it dies."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from PySide6.QtCore import QObject, Signal

from app.agent.child import AgentSource, Refused, Seen, Started, Walked, WalkRequest, serve
from app.agent.state import Walk, WalkedGraph
from app.drawing.life import RESTARTS, Life


class AgentLink(QObject):
    """walked(Walked) and refused(Refused), of the newest walk alone; seen(Seen) after it; troubled(str): the process
    stopped; gaveUp(str): it will not be started again."""

    walked = Signal(object)
    refused = Signal(object)
    seen = Signal(object)
    troubled = Signal(str)
    gaveUp = Signal(str)
    _heard = Signal(int, object)  # from the reading thread: life number, message

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._source: AgentSource | None = None
        self._life: Life | None = None
        self._number = 0  # of the life, so that late words of a former one are not heard
        self._deaths = 0
        self._ready = False
        self._graph: WalkedGraph | None = None
        self._graph_known = False  # to the process
        self._request: WalkRequest | None = None  # the newest
        self._heard.connect(self._on_heard)

    @property
    def ready(self) -> bool:
        """Whether the process answers at once."""
        return self._ready

    @property
    def process_id(self) -> int | None:
        return None if self._life is None or self._life.process is None else self._life.process.pid

    def open(self, source: AgentSource) -> None:
        """Starts the process, in place of the one that runs; it is asked again what was asked last."""
        self.close()
        self._source, self._deaths = source, 0
        self._start()

    def close(self) -> None:
        """Ends the process; may be called again."""
        self._number += 1
        self._ready = self._graph_known = False
        life, self._life = self._life, None
        if life is not None:
            life.end()

    def forget(self) -> None:
        """Nothing is wanted any more."""
        self.close()
        self._request = self._graph = None

    def set_graph(self, graph: WalkedGraph) -> None:
        """What is walked by all that is asked from now on."""
        self._graph, self._graph_known = graph, False

    def ask(self, walk: Walk) -> int:
        """Returns the number that the answers bear."""
        self._request = WalkRequest(1 if self._request is None else self._request.number + 1, walk)
        self._send()
        return self._request.number

    def _start(self) -> None:
        assert self._source is not None
        number = self._number
        self._life = Life(serve, self._source, "agent", lambda message: self._heard.emit(number, message))

    def _send(self) -> None:
        if self._life is None or not self._ready or self._request is None:
            return
        request = self._request if self._graph_known else replace(self._request, graph=self._graph)
        self._graph_known = True
        with contextlib.suppress(OSError):  # the reading thread reports the death, and the next life is asked again
            self._life.connection.send(request)

    def _on_heard(self, number: int, message: object) -> None:
        if number != self._number:
            return
        if message is None:
            self._on_death()
        elif isinstance(message, OSError | RuntimeError):
            self.close()
            self.gaveUp.emit(f"The simulator cannot be started: {message}; close other programs and begin again.")
        elif isinstance(message, Started):
            self._ready = True
            self._send()
        elif isinstance(message, Walked | Refused | Seen):
            if self._request is None or message.number != self._request.number:
                return  # of a walk that has gone on
            kinds = {Walked: self.walked, Refused: self.refused, Seen: self.seen}
            kinds[type(message)].emit(message)

    def _on_death(self) -> None:
        self.close()
        self._deaths += 1
        if self._deaths > RESTARTS:
            self.gaveUp.emit("The simulator stopped repeatedly; Graph > Walk as an agent begins again.")
            return
        self.troubled.emit("The simulator stopped and was started again; the walk goes on where it was.")
        self._start()
