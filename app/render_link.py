"""The window's end of the drawing process: asks for the newest wish only, restarts the process when it dies."""

from __future__ import annotations

import multiprocessing
import threading
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from PySide6.QtCore import QObject, Signal

from app.render_child import Opened, Picture, RenderSource, Request, Trouble, serve

RESTARTS = 2  # a process that dies more often than this stays dead


class RenderLink(QObject):
    """One request is on its way at a time; a newer one replaces the one that waits.

    opened(float) seconds; arrived(Picture); troubled(Trouble).
    """

    opened = Signal(float)
    arrived = Signal(object)
    troubled = Signal(object)
    _heard = Signal(int, object)  # from the reading thread: life number, message

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._source: RenderSource | None = None
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._reader: threading.Thread | None = None
        self._life = 0
        self._deaths = 0
        self._ready = False
        self._sent: Request | None = None
        self._waiting: Request | None = None
        self._heard.connect(self._on_heard)

    @property
    def ready(self) -> bool:
        return self._ready

    @property
    def process_id(self) -> int | None:
        return None if self._process is None else self._process.pid

    @property
    def busy(self) -> bool:
        return self._sent is not None

    def open(self, source: RenderSource) -> None:
        """Starts the process on `source`, in place of the one that runs."""
        self.close()
        self._source, self._deaths = source, 0
        self._start()

    def ask(self, request: Request) -> None:
        """Sends the request, or keeps it until the answer that is under way has come."""
        if not self._ready or self._sent is not None or self._connection is None:
            self._waiting = request
            return
        self._sent, self._waiting = request, None
        try:
            self._connection.send(request)
        except OSError:
            self._waiting = request  # the reading thread reports the death

    def close(self) -> None:
        """Ends the process and the reading thread; may be called again."""
        self._life += 1
        self._ready, self._sent = False, None
        connection, process, reader = self._connection, self._process, self._reader
        self._connection = self._process = self._reader = None
        if process is not None:
            process.terminate()
            process.join()
            process.close()
        if reader is not None:
            reader.join()  # the child's end is closed, so reading has ended
        if connection is not None:
            connection.close()

    def _start(self) -> None:
        assert self._source is not None
        # Spawned: a fork of a process with threads and a window is not safe.
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, self._source), name="nvsim renderer", daemon=True)
        process.start()
        theirs.close()
        self._connection, self._process = ours, process
        self._reader = threading.Thread(target=self._listen, args=(ours, self._life), name="render link", daemon=True)
        self._reader.start()

    def _listen(self, connection: Connection, life: int) -> None:
        try:
            while True:
                self._heard.emit(life, connection.recv())
        except (EOFError, OSError):
            self._heard.emit(life, None)

    def _on_heard(self, life: int, message: object) -> None:
        if life != self._life:
            return
        if message is None:
            self._on_death()
        elif isinstance(message, Opened):
            self._ready = True
            self.opened.emit(message.seconds)
            self._send_waiting()
        elif isinstance(message, Picture):
            self._sent = None
            self._send_waiting()
            self.arrived.emit(message)
        elif isinstance(message, Trouble):
            self._sent = None
            if message.fatal:
                self.close()
            else:
                self._send_waiting()
            self.troubled.emit(message)

    def _send_waiting(self) -> None:
        if self._waiting is not None:
            self.ask(self._waiting)

    def _on_death(self) -> None:
        last = self._sent
        self.close()
        self._deaths += 1
        if self._deaths > RESTARTS:
            self.troubled.emit(Trouble("The renderer stopped repeatedly; the view stays as it is.", fatal=True))
            return
        self._waiting = self._waiting or last
        self.troubled.emit(Trouble("The renderer stopped and was started again."))
        self._start()
