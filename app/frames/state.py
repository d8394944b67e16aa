"""What is known of every frame beyond the capture: how much floor its mask shows, and whether a user corrected it."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from app.frames.link import FrameLink
from app.state.document import Document
from nvsim.project.corrections import corrected_frames
from nvsim.project.results import layout_of


class FrameState(QObject):
    """changed(): coverage or corrections of some frames are others now."""

    changed = Signal()

    def __init__(self, document: Document, link: FrameLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._link = document, link
        self.coverage: dict[int, float] = {}  # frame -> share of its pixels that are floor
        self.corrected: frozenset[int] = frozenset()
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        link.coverageRead.connect(self._on_coverage)

    def learn(self, frame: int, share: float, corrected: bool) -> None:
        """What a correction has just made of a frame."""
        self.coverage[frame] = share
        self.corrected = self.corrected | {frame} if corrected else self.corrected - {frame}
        self.changed.emit()

    def _on_project(self) -> None:
        self.coverage, self.corrected = {}, frozenset()
        path = self._document.path
        self._link.open(path if path is not None and path.is_dir() else None)

    def _on_contents(self, parts: frozenset[str]) -> None:
        # The submaps are read anew whenever a stage begins or ends, the floors among them.
        capture, path = self._document.contents.capture, self._document.path
        if not parts & {"capture", "submaps"} or path is None:
            return
        if "capture" in parts:
            self.coverage = {}
        layout = layout_of(path)
        self.corrected = frozenset() if capture is None else corrected_frames(layout, capture.frames)
        if capture is not None and layout.masks.is_dir():
            self._link.ask_coverage()
        self.changed.emit()

    def _on_coverage(self, shares: dict[int, float]) -> None:
        self.coverage.update(shares)
        self.changed.emit()
