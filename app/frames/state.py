"""What is known of every frame beyond the capture: how much floor its mask shows, whether a user corrected it, whether
it is held out of training, and how well the models show it then."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from app.frames.link import FrameLink
from app.frames.scores import Score, Scores
from app.state.document import Document
from nvsim.project.corrections import corrected_frames
from nvsim.project.results import layout_of


class FrameState(QObject):
    """changed(int first, int last): coverage, corrections or scores of some of these frames are others now."""

    changed = Signal(int, int)

    def __init__(self, document: Document, link: FrameLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._link = document, link
        self.coverage: dict[int, float] = {}  # frame -> share of its pixels that are floor
        self.corrected: frozenset[int] = frozenset()
        self._scores = Scores()
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        link.coverageRead.connect(self._on_coverage)

    def learn(self, frame: int, share: float, corrected: bool) -> None:
        """What a correction has just made of a frame."""
        self.coverage[frame] = share
        self.corrected = self.corrected | {frame} if corrected else self.corrected - {frame}
        self.changed.emit(frame, frame)

    def show_scores(self, scores: Scores) -> None:
        """What an evaluation measured of the frames."""
        if scores != self._scores:
            self._scores = scores
            self._all_changed()

    @property
    def held_out(self) -> frozenset[int]:
        """The frames that no model is trained on."""
        return self._document.contents.held_out

    def score(self, frame: int) -> Score | None:
        """Of a held-out frame that was measured; None of any other."""
        return self._scores.of.get(frame) if frame in self.held_out else None

    @property
    def measured(self) -> bool:
        """Whether there is a held-out frame with a score."""
        return not self.held_out.isdisjoint(self._scores.of)

    @property
    def outdated(self) -> bool:
        """Whether the scores are those of models that are no longer in use."""
        return self._scores.at < self._document.contents.made

    def _on_project(self) -> None:
        self.coverage, self.corrected, self._scores = {}, frozenset(), Scores()
        path = self._document.path
        self._link.open(path if path is not None and path.is_dir() else None)

    def _on_contents(self, parts: frozenset[str]) -> None:
        # The submaps are read anew whenever a stage begins or ends, the floors among them.
        capture, path = self._document.contents.capture, self._document.path
        if path is None:
            return
        if not parts & {"capture", "submaps"}:
            if "scene_stamp" in parts:  # the scores may be of earlier models now
                self._all_changed()
            return
        if "capture" in parts:
            self.coverage = {}
        layout = layout_of(path)
        self.corrected = frozenset() if capture is None else corrected_frames(layout, capture.frames)
        if capture is not None and layout.masks.is_dir():
            self._link.ask_coverage()
        self._all_changed()

    def _on_coverage(self, shares: dict[int, float]) -> None:
        # A batch of some frames: to look at all of many thousand for each would hold up the window.
        self.coverage.update(shares)
        if shares:
            self.changed.emit(min(shares), max(shares))

    def _all_changed(self) -> None:
        capture = self._document.contents.capture
        self.changed.emit(0, max(0, len(capture.frames) - 1) if capture is not None else 0)
