"""The window's end of the process that prepares frames: starts it when first needed, and restarts it if it dies."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QProcess, QTimer, Signal

from app.frames.files import unpacked

_RESTARTS = 2
_REST = 30_000  # milliseconds without a request until the process is ended


class FrameLink(QObject):
    """Sends requests to `app.frames.worker` and emits its answers.

    thumbnailMade(int frame, str file)
    coverageRead(dict frame -> share)            floor shares of some frames
    candidatesMade(int frame, str file)
    prompted(int frame, mask to add, mask to remove)   each (h, w) bool
    failed(str what, int frame, str sentence)    `what` is the kind of request
    """

    thumbnailMade = Signal(int, str)
    coverageRead = Signal(object)
    candidatesMade = Signal(int, str)
    prompted = Signal(int, object, object)
    failed = Signal(str, int, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._root: Path | None = None
        self._process: QProcess | None = None
        self._deaths = 0
        self._last: dict[str, Any] = {}
        self._idle = QTimer(self, singleShot=True, interval=_REST)
        self._idle.timeout.connect(self.rest)

    @property
    def running(self) -> bool:
        return self._process is not None

    def open(self, root: Path | None) -> None:
        """Sets the project of all later requests."""
        self.rest()
        self._root, self._deaths = root, 0

    def open_if_other(self, root: Path) -> None:
        """Sets the project, if it is another one."""
        if root != self._root:
            self.open(root)

    def ask_thumbnails(self, frames: Sequence[int]) -> None:
        """Requests thumbnails in this order. The previous request is replaced."""
        self._send({"do": "thumbnails", "frames": list(frames)})

    def ask_coverage(self) -> None:
        self._send({"do": "coverage"})

    def ask_candidates(self, frame: int) -> None:
        self._send({"do": "candidates", "frame": frame})

    def ask_prompt(self, frame: int, points: Sequence[tuple[float, float, bool]]) -> None:
        """Requests the masks of the prompted network for points: x, y in shares of the image, True for floor."""
        self._send({"do": "prompt", "frame": frame, "points": [list(p) for p in points]})

    def rest(self) -> None:
        """Ends the process. The next request starts another one."""
        self._idle.stop()
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._on_end)
            process.readyReadStandardOutput.disconnect(self._read)
            process.closeWriteChannel()
            process.kill()
            process.waitForFinished(2000)
            process.deleteLater()

    def _send(self, wish: dict[str, Any]) -> None:
        if self._root is None or self._deaths > _RESTARTS:
            return
        if self._process is None:
            process = QProcess(self)
            process.setProgram(sys.executable)
            process.setArguments(["-P", "-m", "app.frames.worker", str(self._root)])
            process.setProcessChannelMode(QProcess.ProcessChannelMode.ForwardedErrorChannel)
            process.readyReadStandardOutput.connect(self._read)
            process.finished.connect(self._on_end)
            process.start()
            self._process = process
        self._last[wish["do"]] = wish
        self._process.write((json.dumps(wish) + "\n").encode())
        self._idle.start()

    def _read(self) -> None:
        process = self._process
        while process is not None and process is self._process and process.canReadLine():
            self._hear(json.loads(bytes(process.readLine().data())))

    def _hear(self, message: dict[str, Any]) -> None:
        self._idle.start()
        match message["did"]:
            case "thumbnail":
                self.thumbnailMade.emit(message["frame"], message["file"])
            case "coverage":
                self.coverageRead.emit({int(k): float(v) for k, v in message["shares"].items()})
            case "candidates":
                self._last.pop("candidates", None)
                self.candidatesMade.emit(message["frame"], message["file"])
            case "prompt":
                self._last.pop("prompt", None)
                height, width = message["shape"]
                masks = (unpacked(message[name], (height, width)) for name in ("add", "take"))
                self.prompted.emit(message["frame"], *masks)
            case "failed":
                self._last.pop(message["do"], None)
                self.failed.emit(message["do"], message["frame"], message["sentence"])

    def _on_end(self) -> None:
        """Restarts a process that died and repeats the last requests, unless it has died too often."""
        process, self._process = self._process, None
        if process is not None:
            process.deleteLater()
        self._deaths += 1
        wishes, self._last = list(self._last.values()), {}
        if self._deaths > _RESTARTS:
            self.failed.emit("open", -1, "The process that prepares thumbnails and candidate masks stopped repeatedly.")
            return
        for wish in wishes:
            self._send(wish)
