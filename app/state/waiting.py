"""Waits for the answer of a child process without blocking the window. Only the newest process is awaited."""

from __future__ import annotations

import threading
from typing import Protocol

from PySide6.QtCore import QObject, Signal

from nvsim.errors import InputError


class Answering(Protocol):
    """A child process with a result; see `app.state.child`."""

    def result(self) -> object | None:
        """Waits for the result. None after `kill`. Raises InputError with the reason if it fails."""
        ...

    def kill(self) -> None: ...


class Waiting(QObject):
    """Waits for a child process in a thread. ended(answer, trouble): the result, None if it failed; and the error
    sentence, "" if there is none."""

    ended = Signal(object, str)
    _heard = Signal(int, object, str)

    def __init__(self, name: str, parent: QObject | None = None) -> None:
        """`name` is the name of the thread."""
        super().__init__(parent)
        self._name = name
        self._child: Answering | None = None
        self._thread: threading.Thread | None = None
        self._number = 0
        self._heard.connect(self._on_heard)

    @property
    def busy(self) -> bool:
        return self._child is not None

    def start(self, child: Answering) -> None:
        """Waits for `child`, and ends the process that was awaited before."""
        self.stop()
        self._child, number = child, self._number

        def work() -> None:
            try:
                self._heard.emit(number, child.result(), "")
            except InputError as error:
                self._heard.emit(number, None, str(error))

        self._thread = threading.Thread(target=work, name=self._name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the awaited process without emitting `ended`, and returns after it has ended."""
        self._number += 1
        if self._child is not None:
            self._child.kill()
        self._forget()

    def _forget(self) -> None:
        if self._thread is not None:
            self._thread.join()
        self._child = self._thread = None

    def _on_heard(self, number: int, answer: object, trouble: str) -> None:
        if number == self._number:
            self._forget()
            self.ended.emit(answer, trouble)
