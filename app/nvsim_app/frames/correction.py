"""The floor mask of one frame during correction: painting with a round brush, growing regions from points, undo. Does
not use Qt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from nvsim.perception.regions import grow_region

_MOST = 200  # maximum number of steps in the history


@dataclass(frozen=True)
class Prompt:
    """A point (x, y) in shares of the image size, 0 to 1, and whether it is on the floor."""

    x: float
    y: float
    floor: bool


@dataclass(frozen=True, eq=False)
class Prompts:
    """Points that are evaluated together, and the mask (H, W) without them."""

    points: tuple[Prompt, ...] = ()
    base: Mask | None = None


@dataclass(frozen=True, eq=False)
class CorrectionStep:
    """One step of the history: the changed box, its pixels before and after as packed bits, and the prompts before and
    after."""

    text: str
    box: Box
    before: NDArray[np.uint8]
    after: NDArray[np.uint8]
    prompts_before: Prompts
    prompts_after: Prompts


class Correction:
    """The floor mask of a frame with its history of corrections.

    mask      (H, W) bool, the current floor; changed in place
    machine   (H, W) bool, the floor that the floors stage found
    """

    def __init__(self, mask: Mask, machine: Mask) -> None:
        """`mask` and `machine` are (H, W) bool. Raises ValueError if their sizes differ."""
        if mask.shape != machine.shape:
            raise ValueError("the masks before and after correction differ in size")
        self.mask, self.machine = mask.copy(), machine
        self._prompts = Prompts()
        self._steps: list[CorrectionStep] = []
        self._index = 0
        self._start: Mask | None = None  # the mask before the current stroke
        self._box: Box | None = None

    # Properties -------------------------------------------------------------------------------------------------

    @property
    def is_corrected(self) -> bool:
        return not np.array_equal(self.mask, self.machine)

    @property
    def prompts(self) -> tuple[Prompt, ...]:
        """The points set since the last stroke."""
        return self._prompts.points

    @property
    def coverage(self) -> float:
        """Share of the pixels that are floor."""
        return float(self.mask.mean())

    @property
    def undo_text(self) -> str:
        """The text of the step that undo would revert, "" if there is none."""
        return self._steps[self._index - 1].text if self._index else ""

    @property
    def redo_text(self) -> str:
        return self._steps[self._index].text if self._index < len(self._steps) else ""

    # Painting ---------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Begins a stroke."""
        self._start, self._box = self.mask.copy(), None

    def paint(self, start: Point, end: Point, radius: float, floor: bool) -> Box | None:
        """Paints a segment of the stroke: from (x, y) to (x, y) with a radius, all in pixels. Returns the box that may
        have changed."""
        box = paint(self.mask, start, end, radius, floor)
        if box is not None:
            self._box = box if self._box is None else self._box | box
        return box

    def end(self, text: str) -> bool:
        """Ends the stroke and records it as one step. Returns False if it changed nothing."""
        start, box, self._start = self._start, self._box, None
        if start is None or box is None:
            return False
        return self._record(text, start, box, Prompts())

    # Whole changes ----------------------------------------------------------------------------------------------

    def replace(self, mask: Mask, text: str) -> Box | None:
        """Replaces the mask by `mask` (H, W) bool. Returns the box of the differences, None if there are none."""
        before, box = self.mask.copy(), changed_box(self.mask, mask)
        if box is None:
            return None
        self.mask[box.slices] = mask[box.slices]
        self._record(text, before, box, Prompts())
        return box

    def revert(self) -> Box | None:
        """Restores the mask that the floors stage found. The step can be undone."""
        return self.replace(self.machine, "Revert to the mask before correction")

    def prompt(self, prompt: Prompt, add: Mask, take: Mask) -> Box:
        """Adds a point to those set since the last stroke.

        The points together add the region `add` to the floor and remove the region `take`; both are (h, w) bool of any
        size. Returns the box that changed."""
        base = self._prompts.base if self._prompts.base is not None else self.mask.copy()
        grown = (base | _enlarged(add, self.mask.shape)) & ~_enlarged(take, self.mask.shape)
        before, box = self.mask.copy(), changed_box(self.mask, grown) or Box(0, 0, 0, 0)
        self.mask[box.slices] = grown[box.slices]
        text = "Add the surface at a point" if prompt.floor else "Remove the surface at a point"
        self._record(text, before, box, Prompts((*self.prompts, prompt), base))
        return box

    # History ----------------------------------------------------------------------------------------------------

    def undo(self) -> Box | None:
        """Undoes a step. Returns the box that changed, None if there is nothing to undo."""
        if not self._index:
            return None
        self._index -= 1
        step = self._steps[self._index]
        return self._show(step.box, step.before, step.prompts_before)

    def redo(self) -> Box | None:
        if self._index == len(self._steps):
            return None
        step = self._steps[self._index]
        self._index += 1
        return self._show(step.box, step.after, step.prompts_after)

    def _show(self, box: Box, bits: NDArray[np.uint8], prompts: Prompts) -> Box:
        part = self.mask[box.slices]
        part[...] = np.unpackbits(bits, count=part.size).reshape(part.shape).astype(bool)
        self._prompts = prompts
        return box

    def _record(self, text: str, before: Mask, box: Box, prompts: Prompts) -> bool:
        old, new = before[box.slices], self.mask[box.slices]
        if np.array_equal(old, new) and prompts.points == self.prompts:
            return False
        del self._steps[self._index :]
        self._steps.append(CorrectionStep(text, box, np.packbits(old), np.packbits(new), self._prompts, prompts))
        del self._steps[: max(0, len(self._steps) - _MOST)]
        self._index = len(self._steps)
        self._prompts = prompts
        return True


def surfaces(prompts: Sequence[Prompt], normals: NDArray[np.float32], image: NDArray[np.uint8]) -> tuple[Mask, Mask]:
    """The surfaces around the floor points, and the surfaces around the other points, each (h, w) bool.

    `normals` (h, w, 3) float32 and `image` (h, w, 3) uint8 have the same size."""
    height, width = image.shape[:2]
    points = np.array([(p.x * width, p.y * height) for p in prompts])
    floor = np.array([p.floor for p in prompts])
    return grow_region(normals, image, points, floor), grow_region(normals, image, points, ~floor)


def _enlarged(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """`mask` (h, w) resampled to another size with a smooth border."""
    import cv2

    if mask.shape == shape:
        return mask
    size = (shape[1], shape[0])
    larger: Mask = np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)) > 0.5
    return larger


Mask = NDArray[np.bool_]
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A rectangle of pixels from (left, top) to (right, bottom), exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def slices(self) -> tuple[slice, slice]:
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def __or__(self, other: Box) -> Box:
        return Box(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )


def paint(mask: Mask, start: Point, end: Point, radius: float, value: bool) -> Box | None:
    """Sets the pixels of `mask` (H, W) that a disc of `radius` pixels covers on its way from `start` to `end`.

    `start` and `end` are (x, y) in pixels; pixel centers are at .5. Returns the box that may have changed, or None if
    the disc stays outside the mask."""
    radius = max(radius, 0.71)  # half the diagonal of a pixel, so that a small brush paints too
    height, width = mask.shape
    (x0, y0), (x1, y1) = start, end
    box = Box(
        max(0, floor(min(x0, x1) - radius)),
        max(0, floor(min(y0, y1) - radius)),
        min(width, ceil(max(x0, x1) + radius)),
        min(height, ceil(max(y0, y1) + radius)),
    )
    if box.left >= box.right or box.top >= box.bottom:
        return None
    x = np.arange(box.left, box.right, dtype=np.float32)[None, :] + np.float32(0.5 - x0)
    y = np.arange(box.top, box.bottom, dtype=np.float32)[:, None] + np.float32(0.5 - y0)
    dx, dy = np.float32(x1 - x0), np.float32(y1 - y0)
    length = dx * dx + dy * dy
    # The nearest point on the segment, as a share of its length.
    share = np.clip((x * dx + y * dy) / length, 0, 1) if length > 0 else np.zeros((1, 1), np.float32)
    inside = (x - share * dx) ** 2 + (y - share * dy) ** 2 <= np.float32(radius**2)
    mask[box.slices][inside] = value
    return box


def changed_box(a: Mask, b: Mask) -> Box | None:
    """The smallest box around the pixels in which two masks (H, W) differ, None if they are equal."""
    different = a != b
    rows = np.flatnonzero(different.any(axis=1))
    if len(rows) == 0:
        return None
    columns = np.flatnonzero(different[rows[0] : rows[-1] + 1].any(axis=0))
    return Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
