"""A round brush on a mask: what one step of a stroke covers. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """Pixels from (left, top) up to, and without, (right, bottom)."""

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
    """Sets what a disc of `radius` pixels passes over from `start` to `end` (x, y; a pixel's centre is at .5); returns
    the box it may have changed, None when that lies outside the mask."""
    radius = max(radius, 0.71)  # half the diagonal of a pixel, or a small brush would paint nothing
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
    # The nearest place of the segment, as a share of it.
    share = np.clip((x * dx + y * dy) / length, 0, 1) if length > 0 else np.zeros((1, 1), np.float32)
    inside = (x - share * dx) ** 2 + (y - share * dy) ** 2 <= np.float32(radius**2)
    mask[box.slices][inside] = value
    return box


def changed(a: Mask, b: Mask) -> Box | None:
    """The smallest box around the pixels in which the masks differ, None where they are the same."""
    different = a != b
    rows = np.flatnonzero(different.any(axis=1))
    if len(rows) == 0:
        return None
    columns = np.flatnonzero(different[rows[0] : rows[-1] + 1].any(axis=0))
    return Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
