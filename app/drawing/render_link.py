"""The window's end of the rendering process."""

from __future__ import annotations

from collections.abc import Hashable

from PySide6.QtCore import QObject, Signal

from app.drawing.painter import Remark
from app.drawing.panorama_child import Panorama, PanoramaRequest
from app.drawing.render_child import Picture, Request, Trouble, serve
from app.processes.child import RESTARTS, Program
from app.processes.serving import Ended
from app.processes.side_process import SideProcess

_PROGRAM = Program(
    serve,
    "renderer",
    "The reconstruction cannot be rendered",
    "close other programs and open the file again",
    "The renderer stopped repeatedly, so the view is not updated; File > Refresh restarts it.",
    RESTARTS,
)


class RenderLink(SideProcess):
    """Renders a RenderSource. A newer request of a view replaces the waiting one.

    arrived(Picture)             an image
    panoramaArrived(Panorama)    a panorama
    troubled(Trouble)            an error
    remarked(Remark)             a message for the log
    """

    arrived = Signal(object)
    panoramaArrived = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_PROGRAM, parent)
        self._panorama: PanoramaRequest | None = None  # the unfinished panorama
        self.heard.connect(self._on_heard)
        self.restarted.connect(lambda: self.troubled.emit(Trouble("The renderer stopped and was restarted.")))
        self.ended.connect(self._on_failure)

    @property
    def busy(self) -> bool:
        """Whether an image is being rendered."""
        return self.ready and bool(self.unanswered - {PanoramaRequest})

    def ask(self, request: Hashable, slot: Hashable = None) -> None:
        super().ask(request, request.view if isinstance(request, Request) else slot)

    def ask_panorama(self, request: PanoramaRequest | None) -> None:
        """Requests a panorama, which replaces the previous request; None requests none. It is rendered between images
        and arrives several times, each time finer."""
        self._panorama = request
        if request is None:
            self.cancel(PanoramaRequest)
        else:
            self.ask(request)

    def _on_heard(self, message: object) -> None:
        if isinstance(message, Picture):
            self.arrived.emit(message)
        elif isinstance(message, Panorama):
            if self._panorama is not None and message.key == self._panorama.key:
                self._panorama = None if message.final else self._panorama
                self.panoramaArrived.emit(message)
        elif isinstance(message, Remark):
            self.remarked.emit(message)
        elif isinstance(message, Trouble):
            self.troubled.emit(message)

    def _on_failure(self, end: Ended) -> None:
        self.troubled.emit(Trouble(end.sentence, end.trace, fatal=True))
