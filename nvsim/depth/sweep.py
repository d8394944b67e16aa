"""The plane sweep: how well each pixel matches the neighboring images, at every depth.

The planes are parallel to the image and evenly spaced in inverse depth. Neighboring images are rotated to the viewing
direction of the image. A plane then only shifts and scales them, so rows stay rows. The cost of a match is the number
of census bits that differ.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.depth.view import NOTHING, census_of
from nvsim.kernels import njit

WORST = 28
"""Largest cost of a source, in bits of the census, and the cost of a source that does not see the point. Bare regions
that do not disagree cost less."""
_LEAST_DEPTH = 0.1  # least depth of a corner of a rotated image, as a share of the depth of its center


@njit(inline="always")
def _bits(value: np.uint64) -> np.uint64:
    """The number of bits that are set, in the form that LLVM compiles to one instruction."""
    v = value - ((value >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (v * np.uint64(0x0101010101010101)) >> np.uint64(56)


@njit(cache=True, nogil=True)
def _count(
    mine: NDArray[np.uint64],
    theirs: NDArray[np.uint64],
    rows: NDArray[np.uint32],
    columns: NDArray[np.uint32],
    best: NDArray[np.uint8],
    following: NDArray[np.uint8],
) -> None:
    """Update the two lowest census distances of every pixel (H, W) with the pixel at `rows` (H,) and `columns` (W,) of
    `theirs`. One loop gathers, and one loop runs for each number width, so that LLVM vectorizes each."""
    height, width = mine.shape
    differ, bits = np.empty(width, np.uint64), np.empty(width, np.uint8)
    for y in range(height):
        here, there, first, second = mine[y], theirs[rows[y]], best[y], following[y]
        for x in range(width):
            differ[x] = here[x] ^ there[columns[x]]
        for x in range(width):
            bits[x] = np.uint8(_bits(differ[x]))
        for x in range(width):
            found = bits[x]
            low, high = first[x], second[x]
            first[x] = found if found < low else low
            larger = low if found < low else found
            second[x] = larger if larger < high else high


@njit(cache=True, nogil=True)
def _transpose(planes: NDArray[np.uint8], cost: NDArray[np.uint8]) -> None:
    """Transpose `planes` (D, N) into `cost` (N, D)."""
    count, size = planes.shape
    block = 64
    for start in range(0, size, block):
        stop = min(start + block, size)
        for d in range(count):
            for i in range(start, stop):
                cost[i, d] = planes[d, i]


def sweep(
    reference: NDArray[np.uint64],
    sources: list[NDArray[np.float32]],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    inverse: NDArray[np.float64],
    threshold: float,
) -> NDArray[np.uint8]:
    """(H, W, D) uint8: cost of every plane at every pixel, the sum of the census distances of the best two sources.

    reference  (H, W) uint64, census of the image
    sources    S arrays (H', W') float32, gray values, negative for pixels that must not be used, S > 0
    rotations  (S, 3, 3), K_s R K^-1 between pixel indices (the center of the first pixel is 0)
    shifts     (S, 3), K_s t: a pixel p at inverse depth w maps to rotations @ p + w * shifts
    inverse    (D,) inverse depths of the planes, 1 / meters
    threshold  of `census_of`
    """
    height, width = reference.shape
    count = len(inverse)
    best = np.full((count, height, width), WORST, np.uint8)
    following = np.full((count, height, width), WORST, np.uint8)
    across, down = np.arange(width), np.arange(height)
    for gray, turned, shift in zip(sources, rotations, shifts, strict=True):
        theirs, left, top = turned_census(gray, turned, width, height, threshold)
        move = np.linalg.solve(turned, shift)
        for d, w in enumerate(inverse):
            scale = 1 + w * move[2]
            if scale <= 0:
                continue  # the plane is behind that camera
            columns = _index((across + w * move[0]) / scale - left, theirs.shape[1])
            rows = _index((down + w * move[1]) / scale - top, theirs.shape[0])
            _count(reference, theirs, rows, columns, best[d], following[d])
    best += following
    best[:, reference == NOTHING] = 2 * WORST  # no depth fits better than another
    cost = np.empty((height * width, count), np.uint8)
    _transpose(best.reshape(count, -1), cost)
    return cost.reshape(height, width, count)


def _index(places: NDArray[np.float64], size: int) -> NDArray[np.uint32]:
    """The nearest of `size` pixels. The outermost pixels represent everything outside the image."""
    return np.clip(np.rint(places) + 1, 0, size - 1).astype(np.uint32)


def turned_census(
    gray: NDArray[np.float32], turned: NDArray[np.float64], width: int, height: int, threshold: float
) -> tuple[NDArray[np.uint64], int, int]:
    """The census of a source `gray` (H', W') float32, rotated to the viewing direction of the image: (R, C) uint64.

    Also returns the column and row of its first pixel in the image of `width` x `height` pixels. Pixels outside the
    source, and a border of one pixel, are `NOTHING`."""
    tall, wide = gray.shape
    corners = np.linalg.solve(turned, np.array([[0, wide - 1, wide - 1, 0], [0, 0, tall - 1, tall - 1], [1, 1, 1, 1]]))
    low, high = np.array([-width // 2, -height // 2]), np.array([3 * width // 2, 3 * height // 2])
    if corners[2].min() > _LEAST_DEPTH * np.linalg.solve(turned, [wide / 2, tall / 2, 1])[2]:
        places = corners[:2] / corners[2]
        low = np.maximum(np.floor(places.min(axis=1)), low).astype(int)
        high = np.minimum(np.ceil(places.max(axis=1)) + 1, high).astype(int)
    columns, rows = np.maximum(high - low, 1)
    into = turned @ np.array([[1.0, 0, low[0]], [0, 1, low[1]], [0, 0, 1]])
    size, flags = (int(columns), int(rows)), cv2.WARP_INVERSE_MAP
    values = cv2.warpPerspective(gray, into, size, flags=flags | cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.warpPerspective(np.ones((tall, wide), np.uint8), into, size, flags=flags | cv2.INTER_NEAREST)
    # A homography does not distinguish front and back.
    depth = (into[2, 0] * np.arange(columns))[None] + (into[2, 1] * np.arange(rows) + into[2, 2])[:, None]
    out = np.full((rows + 2, columns + 2), NOTHING)
    out[1:-1, 1:-1] = np.where((seen > 0) & (depth > 0), census_of(np.asarray(values, np.float32), threshold), NOTHING)
    return out, int(low[0]), int(low[1])


def plane_costs(
    reference: NDArray[np.uint64],
    sources: list[NDArray[np.uint64]],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    forms: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """(D, H, W) uint8: costs as in `sweep`, but for arbitrary planes and with the sources' own census.

    reference  (H, W) uint64, census of the image
    sources    S arrays (H', W') uint64, census of the neighboring images
    forms      (D, 3), one plane each: its inverse depth at the pixel p is forms @ p, 1 / meters
    """
    height, width = reference.shape
    rows, columns = np.arange(height, dtype=np.uint32), np.arange(width, dtype=np.uint32)
    best = np.full((len(forms), height, width), WORST, np.uint8)
    following = np.full((len(forms), height, width), WORST, np.uint8)
    for census, turned, shift in zip(sources, rotations, shifts, strict=True):
        channels = census.view(np.uint16).reshape(*census.shape, 4)
        for d, form in enumerate(forms):
            warped = cv2.warpPerspective(
                channels,
                turned + np.outer(shift, form),
                (width, height),
                flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF),
            )
            _count(reference, warped.view(np.uint64).reshape(height, width), rows, columns, best[d], following[d])
    best += following
    best[:, reference == NOTHING] = 2 * WORST
    return best
