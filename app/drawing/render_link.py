"""The window's end of the drawing process: asks for the newest wish only, restarts the process when it dies."""

from __future__ import annotations

import contextlib

from PySide6.QtCore import QObject, Signal

from app.drawing.life import RESTARTS, Life
from app.drawing.painter import Remark
from app.drawing.panorama_child import Panorama, PanoramaRequest
from app.drawing.render_child import Opened, Picture, RenderSource, Request, Trouble, serve


class RenderLink(QObject):
    """One request is on its way at a time; a newer one replaces the one of the same view that waits.

    opened(float) seconds; arrived(Picture); panoramaArrived(Panorama); troubled(Trouble); remarked(Remark).
    """

    opened = Signal(float)
    arrived = Signal(object)
    panoramaArrived = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)
    _heard = Signal(int, object)  # from the reading thread: life number, message

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._source: RenderSource | None = None
        self._life: Life | None = None
        self._number = 0  # of the life, so that late words of a former one are not heard
        self._deaths = 0
        self._ready = False
        self._sent: Request | None = None
        self._waiting: dict[str, Request] = {}  # by view; who has waited longest is first
        self._panorama: PanoramaRequest | None = None  # the one that is not finished
        self._heard.connect(self._on_heard)

    @property
    def ready(self) -> bool:
        return self._ready

    @property
    def given_up(self) -> bool:
        """Whether there is something to draw and nobody who draws it."""
        return self._source is not None and self._life is None

    @property
    def process_id(self) -> int | None:
        return None if self._life is None or self._life.process is None else self._life.process.pid

    @property
    def busy(self) -> bool:
        return self._sent is not None

    def open(self, source: RenderSource) -> None:
        """Starts the process on `source`, in place of the one that runs."""
        self.close()
        self._source, self._deaths = source, 0
        self._start()

    def ask(self, request: Request) -> None:
        """Sends the request, or holds it back until the answer that is under way has come."""
        if not self._ready or self._sent is not None or self._life is None:
            self._waiting[request.view] = request
            return
        self._waiting.pop(request.view, None)
        self._sent = request
        try:
            self._life.connection.send(request)
        except OSError:
            self._waiting[request.view] = request  # the reading thread reports the death

    def ask_panorama(self, request: PanoramaRequest | None) -> None:
        """Has a panorama drawn in the pauses between images, in place of the one that was asked for before; None asks
        for none. It comes several times, each finer than the one before."""
        self._panorama = request
        if request is not None:
            self._send_panorama()

    def _send_panorama(self) -> None:
        if self._panorama is not None and self._ready and self._life is not None:
            with contextlib.suppress(OSError):  # the reading thread reports the death, and the next life is asked again
                self._life.connection.send(self._panorama)

    def close(self) -> None:
        """Ends the process and the reading thread; may be called again."""
        self._number += 1
        self._ready, self._sent = False, None
        life, self._life = self._life, None
        if life is not None:
            life.end()

    def _start(self) -> None:
        assert self._source is not None
        number = self._number
        self._life = Life(serve, self._source, "renderer", lambda message: self._heard.emit(number, message))

    def _on_heard(self, number: int, message: object) -> None:
        if number != self._number:
            return
        if message is None:
            self._on_death()
        elif isinstance(message, OSError | RuntimeError):
            self.close()
            words = f"The renderer cannot be started: {message}; close other programs and open again."
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
                    "The renderer stopped repeatedly, so the view stays as it is; File > Refresh starts it again.",
                    fatal=True,
                )
            )
            return
        if last is not None:
            self._waiting.setdefault(last.view, last)
        self.troubled.emit(Trouble("The renderer stopped and was started again."))
        self._start()
