"""The candidate masks of the open frame, and the masks of a prompted network; both are computed in another process."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.frames.corrector import Corrector
from app.frames.frame_data import Reader
from app.frames.link import FrameLink
from app.look.notices import Notices
from nvsim.errors import InputError
from nvsim.networks.installed import find_model
from nvsim.perception.hybrid import HybridSteps


class Candidates(QObject):
    """Requests the candidate masks of the open frame and the masks of point prompts.

    made(HybridSteps)   the candidates of the open frame are computed
    changed()           `note` changed
    """

    made = Signal(object)
    changed = Signal()

    def __init__(self, reader: Reader, corrector: Corrector, notices: Notices, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.link = FrameLink(self)
        self._reader, self._corrector, self._notices = reader, corrector, notices
        self._root: Path | None = None
        self._index: int | None = None
        self._asked = self._made = self._waits = False
        self.link.candidatesMade.connect(lambda index, file: reader.read_candidates(index, Path(file)))
        self.link.prompted.connect(corrector.hear_masks)
        self.link.failed.connect(self._on_failed)
        reader.candidatesRead.connect(self.take)
        corrector.promptWanted.connect(self._on_prompt)
        corrector.waiting.connect(self._on_waiting)

    @property
    def note(self) -> str:
        """A sentence about the work in progress; "" if there is none."""
        if self._asked:
            return "Computing the candidate masks; the first of a submap take some seconds…"
        return "The prompted network is running…" if self._waits else ""

    def open(self, root: Path | None, index: int | None) -> None:
        """Sets the open frame of the project at `root`, or None if no frame is open."""
        self._root, self._index, self._asked, self._waits = root, index, False, False
        self._made = False

    def want(self) -> None:
        """Requests the candidates of the open frame, once."""
        if self._root is None or self._index is None or self._asked or self._made:
            return
        self._asked = True
        self.link.open_if_other(self._root)
        self.link.ask_candidates(self._index)
        self.changed.emit()

    def prepare_points(self) -> None:
        """Prepares for point prompts: uses the installed prompted network, or requests the candidates for their
        normals."""
        try:
            network = find_model("prompted") is not None
        except InputError as error:
            self._notices.warning(str(error))
            network = False
        self._corrector.use_network(network)
        if not network:
            self.want()

    def take(self, index: int, steps: HybridSteps) -> None:
        """Receives the candidates of a frame."""
        if index != self._index:
            return
        self._asked, self._made = False, True
        self.made.emit(steps)
        self._corrector.hear_steps(steps)
        self.changed.emit()

    def rest(self) -> None:
        """Ends the process."""
        self.link.rest()

    def _on_failed(self, what: str, index: int, sentence: str) -> None:
        self._notices.warning(sentence)
        if what == "prompt" or index == -1:
            self._corrector.hear_no_masks()
            self.want()
        if what != "prompt" and index in (self._index, -1):
            self._asked, self._made = False, True
            self._corrector.hear_steps(None)
        self.changed.emit()

    def _on_prompt(self, index: int, points: list[tuple[float, float, bool]]) -> None:
        if self._root is not None:
            self.link.open_if_other(self._root)
            self.link.ask_prompt(index, points)

    def _on_waiting(self, waiting: bool) -> None:
        self._waits = waiting
        self.changed.emit()
