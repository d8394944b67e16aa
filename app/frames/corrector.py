"""Correcting the mask of the open frame: the tools in hand, undo and redo, and writing what was done to the disk."""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from app.frames.brush import Box, Mask
from app.frames.correction import Correction, Prompt, surfaces
from app.frames.frame_data import FrameData, Reader
from app.frames.tools import LARGEST, SMALLEST, Brush, Points
from nvsim.perception.hybrid import HybridSteps
from nvsim.project.layout import Layout

_KEPT = 12  # frames whose history is remembered
_PAUSE = 700  # milliseconds after a step until it is written


class Corrector(QObject):
    """changed(Box): the mask of the open frame, within this box; stepped(): after a step, undo or redo; sized();
    moved(QRect): what the cursor covered; waiting(bool): whether points wait for what they need;
    promptWanted(int frame, list of (x, y, floor)): for the user's prompted network."""

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
        self._by_color = False  # there will be no normals
        self._network = False
        self._asked = False  # the network works on the first of those that wait
        self._prompts: list[Prompt] = []  # that wait
        self._kept: OrderedDict[int, Correction] = OrderedDict()
        self.correction: Correction | None = None
        self.brush = Brush(self.changed.emit, self._on_step, lambda _: self.sized.emit(), self.moved.emit)
        self.points = Points(self._place)
        self._unsaved = False
        self._save = QTimer(self, singleShot=True, interval=_PAUSE)
        self._save.timeout.connect(self.flush)

    def forget(self) -> None:
        """Another project."""
        self.close()
        self._kept.clear()

    def open(self, layout: Layout, matter: FrameData) -> None:
        """Takes a frame in hand. Its history goes on where it was left, unless its masks are others by now."""
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
            tool.take(known)

    def close(self) -> None:
        """Writes what is not written yet and closes the frame."""
        self.flush()
        self._matter = self.correction = self._steps = None
        self._prompts = []
        self._by_color = self._asked = False
        for tool in (self.brush, self.points):
            tool.take(None)

    # Steps ------------------------------------------------------------------------------------------------------

    def undo(self) -> None:
        if self.correction is not None:
            self._after(self.correction.undo())

    def redo(self) -> None:
        if self.correction is not None:
            self._after(self.correction.redo())

    def revert(self) -> None:
        """Goes back to the mask that the floors stage found."""
        if self.correction is not None:
            self._after(self.correction.revert())

    def take_candidate(self, name: str) -> None:
        """Takes one of the masks of the hybrid segmentation for the floor."""
        import cv2

        if self.correction is not None and self._steps is not None:
            height, width = self.correction.mask.shape
            mask = getattr(self._steps, name).astype(np.float32)
            larger = np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_LINEAR)) > 0.5
            self._after(self.correction.replace(larger, "Take a candidate mask"))

    def _on_step(self) -> None:
        self._unsaved = True
        self._save.start()
        self.stepped.emit()

    def _after(self, box: Box | None) -> None:
        if box is not None:
            self.changed.emit(box)
            self._on_step()

    # Points -----------------------------------------------------------------------------------------------------

    def use_network(self, use: bool) -> None:
        """Whether points are given to the user's prompted network, through `promptWanted`."""
        self._network = use

    def hear_steps(self, steps: HybridSteps | None) -> None:
        """The normals of the open frame have come, or there will be none."""
        self._steps, self._by_color = steps, steps is None
        self._go_on()

    def hear_masks(self, index: int, add: Mask, take: Mask) -> None:
        """What the network makes of the points that it was given."""
        if self._matter is None or index != self._matter.index or not self._prompts or self.correction is None:
            return
        self._asked = False
        self._after(self.correction.prompt(self._prompts.pop(0), add, take))
        self._go_on()

    def hear_no_masks(self) -> None:
        """The network failed: surfaces are grown from now on."""
        self._asked = self._network = False
        self._go_on()

    def _place(self, prompt: Prompt) -> None:
        self._prompts.append(prompt)
        self._go_on()

    def _go_on(self) -> None:
        """Sets the points that wait, as far as what they need is there."""
        correction, matter = self.correction, self._matter
        while self._prompts and correction is not None and matter is not None and not self._asked:
            prompts = (*correction.prompts, self._prompts[0])
            if self._network:
                self._asked = True
                self.promptWanted.emit(matter.index, [(p.x, p.y, p.floor) for p in prompts])
            elif self._steps is not None or self._by_color:
                self._after(correction.prompt(self._prompts.pop(0), *surfaces(prompts, *self._small(matter.image))))
            else:
                break
        self.waiting.emit(bool(self._prompts))

    def _small(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """The normals, zero where there are none, and the image at their size."""
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
        """Where the size stands between smallest and largest, 0 to 1, by ratio."""
        return math.log(self.brush.radius / SMALLEST) / math.log(LARGEST / SMALLEST)

    def set_brush_share(self, share: float) -> None:
        self.brush.grow(SMALLEST * (LARGEST / SMALLEST) ** share / self.brush.radius)

    # Writing ----------------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Hands what is not written yet to the thread that writes."""
        if not self._unsaved:
            return
        self._unsaved = False
        self._save.stop()
        matter, correction = self._matter, self.correction
        if matter is not None and correction is not None and self._layout is not None:
            mask = correction.mask.copy() if correction.is_corrected else None
            self._reader.write(self._layout, matter.frame, matter.index, mask)
