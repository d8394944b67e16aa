"""The plane sweep: how well each pixel agrees with the same place in neighbouring images, at every depth.

Planes even in inverse depth are laid through the scene, parallel to the image. A plane maps one image onto another by
a homography, so a whole census image is warped at once (by OpenCV, 64 bits as four channels), and what remains is to
count the bits that differ.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

WORST = 28
"""Cost of a source that does not see the place, in bits of the census: bare regions that do not disagree cost less."""
_OUTSIDE = 0xFFFF


@njit(inline="always")
def _bits(value: np.uint64) -> np.uint64:
    """How many bits are set; written in the form that LLVM turns into one instruction."""
    v = value - ((value >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (v * np.uint64(0x0101010101010101)) >> np.uint64(56)


@njit(cache=True, nogil=True)
def _count(
    mine: NDArray[np.uint64], theirs: NDArray[np.uint64], best: NDArray[np.uint8], next_: NDArray[np.uint8]
) -> None:
    """Puts the census distance of every pixel (N,) among the two lowest so far. A census of ones is outside."""
    for i in range(mine.shape[0]):
        other = theirs[i]
        found = np.uint8(_bits(mine[i] ^ other))
        found = np.uint8(WORST) if other == np.uint64(0xFFFFFFFFFFFFFFFF) else found
        first = best[i]
        low = found if found < first else first
        high = first if found < first else found
        best[i] = low
        next_[i] = high if high < next_[i] else next_[i]


@njit(cache=True, nogil=True)
def _turn(planes: NDArray[np.uint8], cost: NDArray[np.uint8]) -> None:
    """cost (N, D) from planes (D, N)."""
    count, size = planes.shape
    block = 64
    for start in range(0, size, block):
        stop = min(start + block, size)
        for d in range(count):
            for i in range(start, stop):
                cost[i, d] = planes[d, i]


def sweep(
    reference: NDArray[np.uint64],
    sources: list[NDArray[np.uint64]],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    inverse: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """(H, W, D) uint8: `plane_costs` of planes parallel to the image, at the inverse depths `inverse` (D,), 1 / metres,
    the costs of a pixel side by side."""
    flat = np.zeros((len(inverse), 3))
    flat[:, 2] = inverse
    height, width = reference.shape
    cost = np.empty((height * width, len(inverse)), np.uint8)
    _turn(plane_costs(reference, sources, rotations, shifts, flat).reshape(len(inverse), -1), cost)
    return cost.reshape(height, width, len(inverse))


def plane_costs(
    reference: NDArray[np.uint64],
    sources: list[NDArray[np.uint64]],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    forms: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """(D, H, W) uint8, the census distances of the best two sources, added.

    reference  (H, W) uint64, census of the image
    sources    S times (H', W') uint64, S > 0
    rotations  (S, 3, 3), K_s R K^-1 between pixel indices (the first pixel's centre is 0)
    shifts     (S, 3), K_s t: a pixel p at inverse depth w falls on rotations @ p + w * shifts
    forms      (D, 3), a plane each: its inverse depth at the pixel p is forms @ p, 1 / metres
    """
    height, width = reference.shape
    size = height * width
    mine = reference.reshape(-1)
    best = np.full((len(forms), size), WORST, np.uint8)
    following = np.full((len(forms), size), WORST, np.uint8)
    for census, turned, shift in zip(sources, rotations, shifts, strict=True):
        channels = census.view(np.uint16).reshape(*census.shape, 4)
        for d, form in enumerate(forms):
            warped = cv2.warpPerspective(
                channels,
                turned + np.outer(shift, form),
                (width, height),
                flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(_OUTSIDE, _OUTSIDE, _OUTSIDE, _OUTSIDE),
            )
            _count(mine, warped.view(np.uint64).reshape(-1), best[d], following[d])
    best += following
    return best.reshape(len(forms), height, width)
