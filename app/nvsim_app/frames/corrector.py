"""Corrects the mask of the open frame: tools, undo and redo, storage of the result, and candidate masks that another
process computes."""

from __future__ import annotations

import math
from collections import OrderedDict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from nvsim.errors import InputError
from nvsim.networks.installed import find_model
from nvsim.perception.hybrid import HybridSteps
from nvsim.project.layout import Layout
from nvsim_app.frames.correction import Box, Correction, Mask, Prompt, surfaces
from nvsim_app.frames.frame_data import FrameData, Reader
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.tools import LARGEST, SMALLEST, Brush, Points
from nvsim_app.look.notices import Notices

_KEPT = 12  # number of frames whose history is kept
_PAUSE = 700  # milliseconds after a step until the mask is written


class Corrector(QObject):
    """Applies tools to the mask of the open frame and writes the result.

    changed(Box)         the mask changed within this box
    stepped()            after a step, undo, or redo
    sized()              the size of the brush changed
    moved(QRect)         the area to repaint after the cursor moved
    waiting(bool)        whether points wait for normals or for the network
    promptWanted(int frame, list of (x, y, floor))   a request for the prompted network
    """

    changed = Signal(object)
    stepped = Signal()
    sized = Signal()
    moved = Signal(object)
    waiting = Signal(bool)
    promptWanted = Signal(int, object)

    def __init__(self, reader: Reader, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._reader = reader
        self._layout: Layout | None = None
        self._matter: FrameData | None = None
        self._steps: HybridSteps | None = None
        self._by_color = False  # regions grow by color, because normals are not available
        self._network = False
        self._asked = False  # the network processes the first waiting point
        self._prompts: list[Prompt] = []  # waiting points
        self._kept: OrderedDict[int, Correction] = OrderedDict()
        self.correction: Correction | None = None
        self.brush = Brush(self.changed.emit, self._on_step, lambda _: self.sized.emit(), self.moved.emit)
        self.points = Points(self._place)
        self._unsaved = False
        self._save = QTimer(self, singleShot=True, interval=_PAUSE)
        self._save.timeout.connect(self.flush)

    def reset(self) -> None:
        """Closes the frame and discards all histories, because the project changed."""
        self.close()
        self._kept.clear()

    def open(self, layout: Layout, matter: FrameData) -> None:
        """Opens a frame. Its history continues, unless its masks have changed since."""
        self.close()
        self._layout, self._matter = layout, matter
        if matter.mask is None or matter.machine is None:
            return
        known = self._kept.pop(matter.index, None)
        if (
            known is None
            or not np.array_equal(known.machine, matter.machine)
            or not np.array_equal(known.mask, matter.mask)
        ):
            known = Correction(matter.mask, matter.machine)
        self._kept[matter.index] = known
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        self.correction = known
        for tool in (self.brush, self.points):
            tool.set_correction(known)

    def close(self) -> None:
        """Writes pending changes and closes the frame."""
        self.flush()
        self._matter = self.correction = self._steps = None
        self._prompts = []
        self._by_color = self._asked = False
        for tool in (self.brush, self.points):
            tool.set_correction(None)

    # Steps ------------------------------------------------------------------------------------------------------

    def undo(self) -> None:
        if self.correction is not None:
            self._on_edited(self.correction.undo())

    def redo(self) -> None:
        if self.correction is not None:
            self._on_edited(self.correction.redo())

    def revert(self) -> None:
        """Restores the mask that the floors stage found."""
        if self.correction is not None:
            self._on_edited(self.correction.revert())

    def take_candidate(self, name: str) -> None:
        """Uses a mask of the hybrid segmentation as floor mask. `name` is an attribute of HybridSteps."""
        import cv2

        if self.correction is not None and self._steps is not None:
            height, width = self.correction.mask.shape
            mask = getattr(self._steps, name).astype(np.float32)
            larger = np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_LINEAR)) > 0.5
            self._on_edited(self.correction.replace(larger, "Use a candidate mask"))

    def _on_step(self) -> None:
        self._unsaved = True
        self._save.start()
        self.stepped.emit()

    def _on_edited(self, box: Box | None) -> None:
        if box is not None:
            self.changed.emit(box)
            self._on_step()

    # Points -----------------------------------------------------------------------------------------------------

    def use_network(self, use: bool) -> None:
        """Sets whether points are sent to the installed prompted network, through `promptWanted`."""
        self._network = use

    def set_normals(self, steps: HybridSteps | None) -> None:
        """Receives the normals of the open frame, or None if there will be none."""
        self._steps, self._by_color = steps, steps is None
        self._apply_waiting_points()

    def apply_network_masks(self, index: int, add: Mask, take: Mask) -> None:
        """Receives the regions of the network for the sent points: to add and to remove, each (h, w) bool."""
        if self._matter is None or index != self._matter.index or not self._prompts or self.correction is None:
            return
        self._asked = False
        self._on_edited(self.correction.prompt(self._prompts.pop(0), add, take))
        self._apply_waiting_points()

    def use_surface_growing(self) -> None:
        """Grows surfaces instead of using the network, because the network failed."""
        self._asked = self._network = False
        self._apply_waiting_points()

    def _place(self, prompt: Prompt) -> None:
        self._prompts.append(prompt)
        self._apply_waiting_points()

    def _apply_waiting_points(self) -> None:
        """Applies the waiting points for which the normals or the network are available."""
        correction, matter = self.correction, self._matter
        while self._prompts and correction is not None and matter is not None and not self._asked:
            prompts = (*correction.prompts, self._prompts[0])
            if self._network:
                self._asked = True
                self.promptWanted.emit(matter.index, [(p.x, p.y, p.floor) for p in prompts])
            elif self._steps is not None or self._by_color:
                self._on_edited(
                    correction.prompt(self._prompts.pop(0), *surfaces(prompts, *self._resized_normals(matter.image)))
                )
            else:
                break
        self.waiting.emit(bool(self._prompts))

    def _resized_normals(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """The normals, zero if unknown, and the image resized to their size."""
        import cv2

        if self._steps is not None:
            normals = self._steps.normals
        else:
            normals = np.zeros((max(1, image.shape[0] // 2), max(1, image.shape[1] // 2), 3), np.float32)
        height, width = normals.shape[:2]
        return normals, np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)

    # The brush's size -------------------------------------------------------------------------------------------

    @property
    def brush_share(self) -> float:
        """The brush radius on a logarithmic scale from smallest (0) to largest (1)."""
        return math.log(self.brush.radius / SMALLEST) / math.log(LARGEST / SMALLEST)

    def set_brush_share(self, share: float) -> None:
        self.brush.grow(SMALLEST * (LARGEST / SMALLEST) ** share / self.brush.radius)

    # Writing ----------------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Passes pending changes to the writing thread."""
        if not self._unsaved:
            return
        self._unsaved = False
        self._save.stop()
        matter, correction = self._matter, self.correction
        if matter is not None and correction is not None and self._layout is not None:
            mask = correction.mask.copy() if correction.is_corrected else None
            self._reader.write(self._layout, matter.frame, matter.index, mask)


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
        self.link.prompted.connect(corrector.apply_network_masks)
        self.link.failed.connect(self._on_failed)
        reader.candidatesRead.connect(self.receive)
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

    def request_once(self) -> None:
        """Requests the candidates of the open frame, once."""
        if self._root is None or self._index is None or self._asked or self._made:
            return
        self._asked = True
        self.link.set_project(self._root)
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
            self.request_once()

    def receive(self, index: int, steps: HybridSteps) -> None:
        """Receives the candidates of a frame."""
        if index != self._index:
            return
        self._asked, self._made = False, True
        self.made.emit(steps)
        self._corrector.set_normals(steps)
        self.changed.emit()

    def _on_failed(self, what: str, index: int, sentence: str) -> None:
        self._notices.warning(sentence)
        if what == "prompt" or index == -1:
            self._corrector.use_surface_growing()
            self.request_once()
        if what != "prompt" and index in (self._index, -1):
            self._asked, self._made = False, True
            self._corrector.set_normals(None)
        self.changed.emit()

    def _on_prompt(self, index: int, points: list[tuple[float, float, bool]]) -> None:
        if self._root is not None:
            self.link.set_project(self._root)
            self.link.ask_prompt(index, points)

    def _on_waiting(self, waiting: bool) -> None:
        self._waits = waiting
        self.changed.emit()
