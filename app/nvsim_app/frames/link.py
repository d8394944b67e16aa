"""The window's end of the process that prepares frames. It starts when first needed, and ends when it is idle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from nvsim_app.frames import worker
from nvsim_app.processes.child import RESTARTS, ChildProgram
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess

_PROGRAM = ChildProgram(
    worker.serve,
    "frames",
    "The frames cannot be prepared",
    crash_text="The process that prepares thumbnails and candidate masks stopped repeatedly.",
    restarts=RESTARTS,
    nice=10,  # the renderer has priority, too
)
_REST = 30_000  # milliseconds without a request or an answer until the process is ended


class FrameLink(QObject):
    """Sends requests to `nvsim_app.frames.worker` and emits its answers. A newer request replaces the previous one of
    its kind.

    thumbnailMade(int frame, str file)
    coverageRead(dict frame -> share, bool)      floor shares of some frames, and whether all masks are read
    candidatesMade(int frame, str file)
    prompted(int frame, mask to add, mask to remove)   each (h, w) bool
    failed(str what, int frame, str sentence)    `what` is the kind of request; "open" and frame -1 if no request works
    """

    thumbnailMade = Signal(int, str)
    coverageRead = Signal(object, bool)
    candidatesMade = Signal(int, str)
    prompted = Signal(int, object, object)
    failed = Signal(str, int, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._root: Path | None = None
        self._thumbnails: list[int] = []  # the requested frames without an answer
        self._process = SideProcess(_PROGRAM, self)
        self._process.heard.connect(self._on_heard)
        self._process.restarted.connect(self._on_restart)
        self._process.ended.connect(self._on_end)
        self._idle = QTimer(self, singleShot=True, interval=_REST)
        self._idle.timeout.connect(self._on_idle)

    @property
    def running(self) -> bool:
        return self._process.running

    @property
    def process_id(self) -> int | None:
        return self._process.process_id

    def open(self, root: Path | None) -> None:
        """Sets the project of all later requests."""
        self.stop_process()
        self._root = root

    def set_project(self, root: Path) -> None:
        """Sets the project, if it is another one."""
        if root != self._root:
            self.open(root)

    def ask_thumbnails(self, frames: Sequence[int]) -> None:
        """Requests thumbnails in this order."""
        self._thumbnails = list(frames)
        if frames:
            self._ask(worker.ThumbnailRequest(tuple(frames)))

    def ask_coverage(self) -> None:
        self._ask(worker.CoverageRequest())

    def ask_candidates(self, frame: int) -> None:
        self._ask(worker.CandidateRequest(frame))

    def ask_prompt(self, frame: int, points: Sequence[tuple[float, float, bool]]) -> None:
        """Requests the masks of the prompted network for points: x, y in shares of the image, True for floor."""
        self._ask(worker.PromptRequest(frame, tuple(points)))

    def stop_process(self) -> None:
        """Ends the process and drops all requests. The next request starts another process."""
        self._idle.stop()
        self._process.close()
        self._drop()

    def _drop(self) -> None:
        for slot in list(self._process.unanswered):
            self._process.cancel(slot)

    def _ask(self, request: worker.Request) -> None:
        if self._root is None or self._process.given_up:
            return
        if not self._process.running:
            self._process.open(self._root)
        self._process.ask(request)
        self._idle.start()

    def _on_idle(self) -> None:
        if self._process.unanswered:
            self._idle.start()
        else:
            self.stop_process()

    def _on_heard(self, message: object) -> None:
        self._idle.start()
        if isinstance(message, worker.Thumbnail):
            self._forget_thumbnail(message.frame)
            self.thumbnailMade.emit(message.frame, str(message.file))
        elif isinstance(message, worker.Coverage):
            self.coverageRead.emit(message.shares, message.complete)
        elif isinstance(message, worker.Candidates):
            self.candidatesMade.emit(message.frame, str(message.file))
        elif isinstance(message, worker.PromptResult):
            self.prompted.emit(message.frame, message.add, message.take)
        elif isinstance(message, worker.FailedRequest):
            if message.what == "thumbnail":
                self._forget_thumbnail(message.frame)
            self.failed.emit(message.what, message.frame, message.sentence)

    def _forget_thumbnail(self, frame: int) -> None:
        if frame in self._thumbnails:
            self._thumbnails.remove(frame)

    def _on_restart(self) -> None:
        if worker.ThumbnailRequest in self._process.unanswered:
            self.ask_thumbnails(self._thumbnails)

    def _on_end(self, end: EndMessage) -> None:
        self._drop()
        self.failed.emit("open", -1, end.sentence)
