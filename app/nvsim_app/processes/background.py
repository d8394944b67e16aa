"""Runs functions in threads of this process. Side processes are in the other modules."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from PySide6.QtCore import QObject, Signal

from nvsim.errors import UserError

Result = TypeVar("Result")


class BackgroundWork(QObject):
    """Runs work in a thread, and passes its result to the main thread. Only the result of the newest work is passed."""

    _ended = Signal(int, object, str)  # from the thread: the number of the work, its result, the error sentence or ""

    def __init__(self, name: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._name = name
        self._number = 0
        self._thread: threading.Thread | None = None
        self._receivers: tuple[Callable[[Any], object], Callable[[str], object]] | None = None
        self._ended.connect(self._on_ended)

    @property
    def busy(self) -> bool:
        """Whether a result is awaited."""
        return self._receivers is not None

    def start(
        self, work: Callable[[], Result], done: Callable[[Result], object], failed: Callable[[str], object]
    ) -> None:
        """Starts `work` in a thread. Then calls `done` with its result, or `failed` with the sentence of a UserError,
        in the main thread."""
        self._number += 1
        number, self._receivers = self._number, (done, failed)

        def run() -> None:
            found, trouble = None, ""
            try:
                found = work()
            except UserError as error:
                trouble = str(error)
            with contextlib.suppress(RuntimeError):  # this object may be deleted meanwhile
                self._ended.emit(number, found, trouble)

        self._thread = threading.Thread(target=run, name=self._name, daemon=True)
        self._thread.start()

    def drop(self) -> None:
        """Drops the awaited result."""
        self._receivers = None

    def stop(self) -> None:
        """Drops the awaited result, and returns when the newest work has ended."""
        self.drop()
        if self._thread is not None:
            self._thread.join()

    def _on_ended(self, number: int, found: Any, trouble: str) -> None:
        if number != self._number or self._receivers is None:
            return
        (done, failed), self._receivers = self._receivers, None
        if trouble:
            failed(trouble)
        else:
            done(found)
