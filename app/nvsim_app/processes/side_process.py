"""A side process of the window: sends the newest requests, and restarts the process if it crashes."""

from __future__ import annotations

import contextlib
from collections.abc import Hashable, KeysView
from dataclasses import dataclass

from PySide6.QtCore import QObject, Signal

from nvsim_app.processes.child import Child, ChildProgram
from nvsim_app.processes.serving import Answer, EndMessage, Notice, ReadyMessage


@dataclass(eq=False)
class _PendingRequest:
    number: int
    request: object
    sent: bool = False


class SideProcess(QObject):
    """Runs a program in a process of its own and talks to it without blocking the window.

    Every request belongs to a slot, by default its type. A newer request replaces the unanswered request of its slot.
    When the process is free, it gets the request of the slot that waits longest. A restarted process gets the
    unanswered requests again, but not the answered ones.

    opened()         the process can answer requests
    heard(object)    an answer or a notice of the process
    restarted()      the process crashed and is started again
    ended(Ended)     the work is done, or it failed and the process is not started again. Not emitted after `close`
    """

    opened = Signal()
    heard = Signal(object)
    restarted = Signal()
    ended = Signal(object)
    _arrived = Signal(object, object)  # from the reading thread: the Child, its message

    def __init__(self, program: ChildProgram, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._program = program
        self._source: object = None
        self._running: list[Child] = []  # at most one
        self._crashes = 0
        self._ready = self._given_up = False
        self._number = 0  # of the last request
        self._sent: int | None = None  # the request that the process receives or works on alone
        self._asked: dict[Hashable, _PendingRequest] = {}  # by slot, the longest waiting first
        self._arrived.connect(self._on_arrived)
        running = self._running
        self.destroyed.connect(lambda: _end(running))

    @property
    def ready(self) -> bool:
        """Whether the process has opened its source."""
        return self._ready

    @property
    def running(self) -> bool:
        return bool(self._running)

    @property
    def given_up(self) -> bool:
        """Whether the process failed and is not started again."""
        return self._given_up

    @property
    def unanswered(self) -> KeysView[Hashable]:
        """The slots with a request whose last answer has not arrived."""
        return self._asked.keys()

    @property
    def process_id(self) -> int | None:
        return self._running[0].process_id if self._running else None

    def open(self, source: object) -> None:
        """Starts the program on `source`, and ends the running process. The unanswered requests are sent to the new
        process."""
        self.close()
        self._source, self._crashes = source, 0
        self._start()

    def ask(self, request: Hashable, slot: Hashable = None) -> None:
        """Sends a request when the process is free."""
        slot = type(request) if slot is None else slot
        if slot in self._asked and self._asked[slot].sent:
            del self._asked[slot]  # the new one waits behind all others
        self._number += 1
        self._asked[slot] = _PendingRequest(self._number, request)
        self._send()

    def cancel(self, slot: Hashable) -> None:
        """Drops the request of a slot. Answers to a request that was sent already still arrive."""
        self._asked.pop(slot, None)

    def close(self) -> None:
        """Ends the process, and returns after it has ended. You can call it more than once."""
        self._given_up = False
        self._disconnect()

    def _start(self) -> None:
        self._running.append(Child(self._program, self._source, self._arrived.emit))

    def _disconnect(self) -> None:
        self._ready, self._sent = False, None
        for asked in self._asked.values():
            asked.sent = False
        _end(self._running)

    def _send(self) -> None:
        if not self._running or not self._ready or self._sent is not None:
            return
        asked = next((asked for asked in self._asked.values() if not asked.sent), None)
        if asked is not None:
            asked.sent, self._sent = True, asked.number
            with contextlib.suppress(OSError):  # the reading thread reports the end, and the next process gets it
                self._running[0].send(asked.number, asked.request)

    def _on_arrived(self, child: Child, message: object) -> None:
        if child not in self._running:
            return  # a late message of an ended process
        if isinstance(message, ReadyMessage):
            self._on_free(message.number)
        elif isinstance(message, Answer):
            if not message.more:
                self._finish(message.number)
            if message.value is not None:
                self.heard.emit(message.value)
        elif isinstance(message, Notice):
            self.heard.emit(message.value)
        elif isinstance(message, EndMessage):
            self._on_end(message)

    def _on_free(self, number: int) -> None:
        if not self._ready:
            self._ready = True
            self.opened.emit()
        if self._sent == number:
            self._sent = None
        self._send()

    def _finish(self, number: int) -> None:
        slot = next((slot for slot, asked in self._asked.items() if asked.number == number), None)
        if slot is not None:
            del self._asked[slot]
        if self._sent == number:  # the process is free after its last answer
            self._sent = None
            self._send()

    def _on_end(self, end: EndMessage) -> None:
        self._disconnect()
        if not end.crashed or self._crashes >= self._program.restarts:
            self._given_up = bool(end.sentence)
            self.ended.emit(end)
            return
        self._crashes += 1
        self._start()
        self.restarted.emit()


def _end(running: list[Child]) -> None:
    """Ends the running process, also after its SideProcess was deleted."""
    while running:
        running.pop().end()
