"""The state of every frame beyond the capture: floor share, correction, and whether it is held out, with its scores."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from PySide6.QtCore import QObject, Signal

from nvsim.files.frame_numbers import number_in
from nvsim.perception.failures import read_failures
from nvsim.project.corrections import corrected_frames
from nvsim.project.project import layout_of
from nvsim_app.frames.link import FrameLink
from nvsim_app.state.document import Document
from nvsim_app.state.results import EvaluationResult, ResultTable

_COLUMNS = ("frame", "psnr", "ssim")


@dataclass(frozen=True)
class Score:
    """PSNR in decibels and SSIM of one frame, over all usable pixels."""

    psnr: float
    ssim: float

    @property
    def words(self) -> str:
        """The scores as text, for example "PSNR 24.1 dB, SSIM 0.83"."""
        return f"PSNR {self.psnr:.1f} dB, SSIM {self.ssim:.2f}"


@dataclass(frozen=True)
class Scores:
    """The scores of all measured frames, by frame index, and the time of measurement in seconds since the epoch."""

    of: dict[int, Score] = field(default_factory=dict)
    at: float = 0.0


def newest_scores(results: Iterable[EvaluationResult]) -> Scores:
    """The scores of the last evaluation of held-out frames; empty if there was none."""
    for result in sorted(results, key=lambda r: -r.at):
        for table in result.tables:
            found = _scores_in(table)
            if found:
                return Scores(found, result.at)
    return Scores()


def _scores_in(table: ResultTable) -> dict[int, Score]:
    """The scores in a table that has a row for each frame; empty for other tables."""
    if not set(_COLUMNS) <= set(table.columns):
        return {}
    frame, psnr, ssim = (table.columns.index(name) for name in _COLUMNS)
    found = {}
    for row in table.rows:
        values = row[psnr], row[ssim]
        if type(row[frame]) is int and all(type(v) in (int, float) for v in values):
            found[row[frame]] = Score(float(values[0]), float(values[1]))
    return found


class FrameState(QObject):
    """Stores the state of all frames. changed(int first, int last): the state of some frames in this range changed."""

    changed = Signal(int, int)

    def __init__(self, document: Document, link: FrameLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._link = document, link
        self.coverage: dict[int, float] = {}  # frame -> share of floor pixels
        self.reading = False
        """Whether there are masks whose floor share is not read yet."""
        self.corrected: frozenset[int] = frozenset()
        self._failed: frozenset[int] = frozenset()  # frames whose mask may be wrong
        self._scores = Scores()
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        link.coverageRead.connect(self._on_coverage)
        link.failed.connect(self._on_failed)

    def learn(self, frame: int, share: float, corrected: bool) -> None:
        """Updates the floor share and the correction state of a frame after a correction."""
        self.coverage[frame] = share
        self.corrected = self.corrected | {frame} if corrected else self.corrected - {frame}
        self.changed.emit(frame, frame)

    def show_scores(self, scores: Scores) -> None:
        """Sets the scores of an evaluation."""
        if scores != self._scores:
            self._scores = scores
            self._all_changed()

    @property
    def doubtful(self) -> frozenset[int]:
        """The frames whose floor mask may be wrong and was not corrected."""
        return self._failed - self.corrected

    @property
    def held_out(self) -> frozenset[int]:
        """The frames that no model is trained on."""
        return self._document.contents.held_out

    def score(self, frame: int) -> Score | None:
        """The score of a measured held-out frame; None for other frames."""
        return self._scores.of.get(frame) if frame in self.held_out else None

    @property
    def measured(self) -> bool:
        """Whether there is a held-out frame with a score."""
        return not self.held_out.isdisjoint(self._scores.of)

    @property
    def outdated(self) -> bool:
        """Whether the models were trained again after the scores were measured."""
        return self._scores.at < self._document.contents.modified_time

    def _on_project(self) -> None:
        self.coverage, self.corrected, self._failed, self._scores = {}, frozenset(), frozenset(), Scores()
        self.reading = False
        path = self._document.path
        self._link.open(path if path is not None and path.is_dir() else None)

    def _on_contents(self, parts: frozenset[str]) -> None:
        # The submaps are reloaded when any stage begins or ends, including the floors stage.
        capture, path = self._document.contents.capture, self._document.path
        if path is None:
            return
        if not parts & {"capture", "submaps"}:
            if "scene_stamp" in parts:  # the scores may be outdated
                self._all_changed()
            return
        if "capture" in parts:
            self.coverage = {}
        layout = layout_of(path)
        self.corrected = frozenset() if capture is None else corrected_frames(layout, capture.frames)
        failed, frames = read_failures(layout.masks), () if capture is None else capture.frames
        self._failed = frozenset(i for i, f in enumerate(frames) if number_in(layout.masks, f.name, i) in failed)
        self.reading = capture is not None and layout.masks.is_dir()
        if self.reading:
            self._link.ask_coverage()
        self._all_changed()

    def _on_coverage(self, shares: dict[int, float], complete: bool) -> None:
        # Emit only the range of this batch, because updating thousands of frames for each batch would block the window.
        self.coverage.update(shares)
        if shares:
            self.changed.emit(min(shares), max(shares))
        if complete:
            self.reading = False
            self._all_changed()

    def _on_failed(self, what: str, _: int, __: str) -> None:
        if what == "open":
            self.reading = False
            self._all_changed()

    def _all_changed(self) -> None:
        capture = self._document.contents.capture
        self.changed.emit(0, max(0, len(capture.frames) - 1) if capture is not None else 0)


def mask_words(state: FrameState, frame: int) -> str:
    """The floor share of a frame as text, for example "23 % floor"."""
    share = state.coverage.get(frame)
    if share is not None:
        return f"{100 * share:.0f} % floor"
    return "reading masks…" if state.reading else "no mask yet"


def coverage_words(state: FrameState, frame: int) -> str:
    """The floor share of a frame as text, for example "23 % floor, corrected by hand"."""
    words = mask_words(state, frame)
    if frame in state.doubtful:
        return f"{words}, doubtful"
    return f"{words}, corrected by hand" if frame in state.corrected else words


def frame_words(state: FrameState, frame: int) -> str:
    """The state of a frame as text, for example "23 % floor, held out: PSNR 24.1 dB, SSIM 0.83"."""
    words = coverage_words(state, frame)
    if frame not in state.held_out:
        return words
    score = state.score(frame)
    if score is None:
        return f"{words}, held out of training"
    return f"{words}, held out: {score.words}{' of earlier models' if state.outdated else ''}"
