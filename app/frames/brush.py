"""Painting on a mask with a round brush. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

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


def changed(a: Mask, b: Mask) -> Box | None:
    """The smallest box around the pixels in which two masks (H, W) differ, None if they are equal."""
    different = a != b
    rows = np.flatnonzero(different.any(axis=1))
    if len(rows) == 0:
        return None
    columns = np.flatnonzero(different[rows[0] : rows[-1] + 1].any(axis=0))
    return Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
