"""Detects floor materials from their joints: planks have one direction, tiles two. Other floors have no material.

The method uses the orientation of lightness gradients (Bigün and Granlund 1987, the structure tensor). Doubled angles
detect joints in one direction, and angles times four detect joints at right angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.colour_names import lab_of
from nvsim.r2r.surroundings.floor_patch import PIXEL, FloorPatch
from nvsim.r2r.surroundings.layers import CELL, Layers

MATERIALS = ("wooden", "tiled")
UNSURE, UNSEEN = -1, -2
_NEAR, _WIDE = 0.8, 1.2  # sides in meters of the squares in which planks and tiles are detected
_FILLED = 0.6  # smallest visible share of a square
_JOINTS = 1.2  # smallest gradient of a pattern, lightness units per pixel, root mean square
_ONE_WAY = 0.6  # smallest share of gradients in one direction for planks
_TWO_WAYS, _NOT_ONE = 0.16, 0.4  # for tiles: smallest share in two perpendicular directions, largest share in one
_WOOD_HUES, _WOOD_CHROMA = (48.0, 85.0), 13.0  # degrees and units of CIELAB
_TILE_CHROMA = 10.0  # more colorful patterns may be carpets


def floor_materials(layers: Layers) -> NDArray[np.int64]:
    """Returns (rows, columns) indices into MATERIALS, UNSURE if the pattern is unclear, UNSEEN if no patch shows it."""
    import cv2

    sums = np.zeros((9, *layers.shape), np.float64)
    for one in layers.seen:
        _add(sums, layers, one.underfoot)
    seen, energy, cos2, sin2, cos4, sin4, *lab = sums

    def over(metres: float, values: NDArray[np.float64]) -> NDArray[np.float64]:
        side = round(metres / CELL) | 1
        return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_CONSTANT))

    count = np.maximum(over(_NEAR, seen), 1e-9)
    full = over(_NEAR, (seen > 0).astype(np.float64)) >= _FILLED
    power = np.maximum(over(_NEAR, energy), 1e-9)
    patterned = full & (power / count >= _JOINTS**2)
    one_way = np.hypot(over(_NEAR, cos2), over(_NEAR, sin2)) / power
    two_ways = np.hypot(over(_WIDE, cos4), over(_WIDE, sin4)) / np.maximum(over(_WIDE, energy), 1e-9)
    a, b = over(_NEAR, lab[1]) / count, over(_NEAR, lab[2]) / count
    chroma, hue = np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360
    brownish = (chroma >= _WOOD_CHROMA) & (hue >= _WOOD_HUES[0]) & (hue <= _WOOD_HUES[1])
    found = np.full(layers.shape, UNSURE, np.int64)
    found[patterned & brownish & (one_way >= _ONE_WAY)] = MATERIALS.index("wooden")
    tiled = (chroma <= _TILE_CHROMA) & (one_way <= _NOT_ONE) & (two_ways >= _TWO_WAYS)
    found[patterned & tiled] = MATERIALS.index("tiled")
    return np.where(seen > 0, found, UNSEEN)


def _add(sums: NDArray[np.float64], layers: Layers, patch: FloorPatch) -> None:
    """Adds a patch to the sums (9, rows, columns) of each cell.

    The sums are: pixels; squared gradients; these times cos and sin of twice and four times their angle; and CIELAB.
    """
    import cv2

    lab = lab_of(patch.colours.astype(np.float32))
    light = cv2.GaussianBlur(np.ascontiguousarray(lab[..., 0]), (0, 0), 1.0)
    dx, dy = (cv2.Sobel(light, cv2.CV_32F, i, 1 - i, ksize=3) / 8 for i in (1, 0))
    inside = cv2.erode(patch.seen.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=0).astype(bool)
    rows, columns = np.nonzero(inside)
    xy = np.stack([columns, rows], axis=1) * PIXEL + (np.array(patch.low) + PIXEL / 2)
    cells = layers.cells_of(xy)
    flat = cells[:, 0] * layers.shape[1] + cells[:, 1]
    gx, gy = dx[inside].astype(np.float64), dy[inside].astype(np.float64)
    square = (gx + 1j * gy) ** 2  # has twice the angle
    power = np.abs(square)
    fourth = square**2 / np.maximum(power, 1e-12)
    values = [np.ones_like(gx), power, square.real, square.imag, fourth.real, fourth.imag, *lab[inside].T]
    for total, value in zip(sums, values):
        total += np.bincount(flat, value, layers.shape[0] * layers.shape[1]).reshape(layers.shape)
