"""The window's end of the rendering process: sends only the newest request of each view, and restarts the process if it
dies."""

from __future__ import annotations

import contextlib

from PySide6.QtCore import QObject, Signal

from app.drawing.painter import Remark
from app.drawing.panorama_child import Panorama, PanoramaRequest
from app.drawing.pipe_process import RESTARTS, PipeProcess
from app.drawing.render_child import Opened, Picture, RenderSource, Request, Trouble, serve


class RenderLink(QObject):
    """Sends one request at a time. A newer request replaces the waiting request of its view.

    opened(float)                the source is open; the seconds this took
    arrived(Picture)             an image
    panoramaArrived(Panorama)    a panorama
    troubled(Trouble)            an error
    remarked(Remark)             a message for the log
    """

    opened = Signal(float)
    arrived = Signal(object)
    panoramaArrived = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)
    _heard = Signal(int, object)  # from the reading thread: number of the process, message

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._source: RenderSource | None = None
        self._child: PipeProcess | None = None
        self._number = 0  # counts processes, so that late messages of an ended process are dropped
        self._deaths = 0
        self._ready = False
        self._sent: Request | None = None
        self._waiting: dict[str, Request] = {}  # by view, the longest waiting first
        self._panorama: PanoramaRequest | None = None  # the unfinished panorama
        self._heard.connect(self._on_heard)

    @property
    def ready(self) -> bool:
        return self._ready

    @property
    def given_up(self) -> bool:
        """Whether a source is set but no process renders it."""
        return self._source is not None and self._child is None

    @property
    def process_id(self) -> int | None:
        return None if self._child is None or self._child.process is None else self._child.process.pid

    @property
    def busy(self) -> bool:
        return self._sent is not None

    def open(self, source: RenderSource) -> None:
        """Starts a process on `source`, and ends the running one."""
        self.close()
        self._source, self._deaths = source, 0
        self._start()

    def ask(self, request: Request) -> None:
        """Sends the request now, or after the pending answer has arrived."""
        if not self._ready or self._sent is not None or self._child is None:
            self._waiting[request.view] = request
            return
        self._waiting.pop(request.view, None)
        self._sent = request
        try:
            self._child.connection.send(request)
        except OSError:
            self._waiting[request.view] = request  # the reading thread reports the death

    def ask_panorama(self, request: PanoramaRequest | None) -> None:
        """Requests a panorama, which replaces the previous request; None requests none. It is rendered between images
        and arrives several times, each time finer."""
        self._panorama = request
        if request is not None:
            self._send_panorama()

    def _send_panorama(self) -> None:
        if self._panorama is not None and self._ready and self._child is not None:
            with contextlib.suppress(OSError):  # the reading thread reports it; the next process gets the request
                self._child.connection.send(self._panorama)

    def close(self) -> None:
        """Ends the process and the reading thread. You can call it more than once."""
        self._number += 1
        self._ready, self._sent = False, None
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def _start(self) -> None:
        assert self._source is not None
        number = self._number
        self._child = PipeProcess(serve, self._source, "renderer", lambda message: self._heard.emit(number, message))

    def _on_heard(self, number: int, message: object) -> None:
        if number != self._number:
            return
        if message is None:
            self._on_death()
        elif isinstance(message, OSError | RuntimeError):
            self.close()
            words = f"The renderer cannot be started: {message}; close other programs and open the file again."
            self.troubled.emit(Trouble(words, fatal=True))
        elif isinstance(message, Opened):
            self._ready = True
            self.opened.emit(message.seconds)
            self._send_waiting()
            self._send_panorama()
        elif isinstance(message, Picture):
            self._sent = None
            self._send_waiting()
            self.arrived.emit(message)
        elif isinstance(message, Panorama):
            if self._panorama is not None and message.key == self._panorama.key:
                self._panorama = None if message.final else self._panorama
                self.panoramaArrived.emit(message)
        elif isinstance(message, Remark):
            self.remarked.emit(message)
        elif isinstance(message, Trouble):
            self._sent = None
            if message.fatal:
                self.close()
            else:
                self._send_waiting()
            self.troubled.emit(message)

    def _send_waiting(self) -> None:
        if self._waiting:
            self.ask(self._waiting.pop(next(iter(self._waiting))))

    def _on_death(self) -> None:
        last = self._sent
        self.close()
        self._deaths += 1
        if self._deaths > RESTARTS:
            self.troubled.emit(
                Trouble(
                    "The renderer stopped repeatedly, so the view is not updated; File > Refresh restarts it.",
                    fatal=True,
                )
            )
            return
        if last is not None:
            self._waiting.setdefault(last.view, last)
        self.troubled.emit(Trouble("The renderer stopped and was restarted."))
        self._start()
