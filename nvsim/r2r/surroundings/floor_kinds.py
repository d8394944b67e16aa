"""Names the floor of a storey: a rug, wooden, tiled, or only by its color if its pattern is unclear.

Materials are detected from their joints: planks have one direction, tiles two. Other floors have no material. The
method uses the orientation of lightness gradients (Bigün and Granlund 1987, the structure tensor). Doubled angles
detect joints in one direction, and angles times four detect joints at right angles.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.layers import CELL, FLOOR, Layers
from nvsim.r2r.surroundings.naming import COLORS, NAMELESS, are_colors_distinct, lab_of, names_of
from nvsim.r2r.surroundings.visibility import PIXEL, FloorPatch

_BLUR = 0.5  # meters over which patterns are averaged
MATERIALS = ("wooden", "tiled")
UNSURE, UNSEEN = -1, -2
_NEAR, _WIDE = 0.8, 1.2  # sides in meters of the squares in which planks and tiles are detected
_VISIBLE = 0.6  # smallest visible share of a square
_JOINTS = 1.2  # smallest gradient of a pattern, lightness units per pixel, root mean square
_ONE_WAY = 0.6  # smallest share of gradients in one direction for planks
_TWO_WAYS, _NOT_ONE = 0.16, 0.4  # for tiles: smallest share in two perpendicular directions, largest share in one
_WOOD_HUES, _WOOD_CHROMA = (48.0, 85.0), 13.0  # degrees and units of CIELAB
_TILE_CHROMA = 10.0  # more colorful patterns may be carpets
RUG = "rug"
FLOORS = (*COLORS, *MATERIALS, *(f"{color} {RUG}" for color in COLORS))
"""Names of floors."""
EVERY = 0.2
"""Meters between the positions at which the floor is sampled."""
_RUGS = ("red", "green", "blue", "purple", "yellow")  # patches of other colors may be shadows or tile patterns
_SHORTEST, _LONGEST, _FILLED = 0.7, 3.5, 0.75  # smallest and largest side of a rug in meters; share of its rectangle
_RING, _AROUND = (0.35, 0.9), 0.5  # ring around a rug, in meters off it, and the share of the ring with another floor
_WALLED = 0.15  # largest share of walls in the cells next to a rug
_MOSTLY, _NEARLY_ALL = 0.5, 0.9  # share of one material in a patch of one color, and in its cells with clear material
_LEAST = 0.5  # square meters that a patch needs
_LIKE = {"wooden": ("brown", "beige", "red", "yellow"), "tiled": ("white", "gray", "black", "beige")}


def floor_names(layers: Layers) -> NDArray[np.int64]:
    """Returns (rows, columns) indices of floor colors into COLORS, NAMELESS for unseen or unnamed floor."""
    import cv2

    on = np.abs(layers.height_above_floor) <= FLOOR + CELL / 2
    at = layers.voxels[on]
    lab = np.zeros((*layers.shape, 4), np.float32)
    for i, values in enumerate([*lab_of(layers.colors[on]).T, np.ones(len(at), np.float32)]):
        np.add.at(lab[..., i], (at[:, 1], at[:, 0]), values)
    side = round(_BLUR / CELL) | 1
    blurred = cv2.blur(lab, (side, side), borderType=cv2.BORDER_CONSTANT)
    seen = lab[..., 3] > 0
    mean = blurred[..., :3] / np.maximum(blurred[..., 3:], 1e-6)
    return np.where(seen, names_of(mean), NAMELESS)


def floor_materials(layers: Layers) -> NDArray[np.int64]:
    """Returns (rows, columns) indices into MATERIALS, UNSURE if the pattern is unclear, UNSEEN if no patch shows it."""
    import cv2

    sums = np.zeros((9, *layers.shape), np.float64)
    for one in layers.seen:
        _add(sums, layers, one.underfoot)
    seen, energy, cos2, sin2, cos4, sin4, *lab = sums

    def mean_over(meters: float, values: NDArray[np.float64]) -> NDArray[np.float64]:
        side = round(meters / CELL) | 1
        return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_CONSTANT))

    count = np.maximum(mean_over(_NEAR, seen), 1e-9)
    full = mean_over(_NEAR, (seen > 0).astype(np.float64)) >= _VISIBLE
    power = np.maximum(mean_over(_NEAR, energy), 1e-9)
    patterned = full & (power / count >= _JOINTS**2)
    one_way = np.hypot(mean_over(_NEAR, cos2), mean_over(_NEAR, sin2)) / power
    two_ways = np.hypot(mean_over(_WIDE, cos4), mean_over(_WIDE, sin4)) / np.maximum(mean_over(_WIDE, energy), 1e-9)
    a, b = mean_over(_NEAR, lab[1]) / count, mean_over(_NEAR, lab[2]) / count
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

    lab = lab_of(patch.colors.astype(np.float32))
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


def floor_kinds(layers: Layers, walls: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns (rows, columns) indices into FLOORS, NAMELESS for unseen or unnamed floor; `walls` (rows, columns)."""
    colors, made_of = floor_names(layers), floor_materials(layers)
    found = np.where(made_of >= 0, made_of + len(COLORS), colors)
    for _, patch in _patches(colors):
        looks = made_of[patch & (made_of != UNSEEN)]
        sure = np.bincount(looks[looks >= 0], minlength=len(MATERIALS))
        best = int(sure.argmax())
        if sure[best] >= max(_LEAST / CELL**2, _MOSTLY * len(looks), _NEARLY_ALL * sure.sum()):
            found[patch] = len(COLORS) + best
    named = found.copy()
    for i, patch in _patches(named):
        if _lies_on_another(patch, named, walls):
            found[patch] = FLOORS.index(f"{FLOORS[i]} {RUG}") if FLOORS[i] in _RUGS else NAMELESS
    return found


def floor_along(
    kinds: NDArray[np.int64], layers: Layers, a: NDArray[np.floating], b: NDArray[np.floating]
) -> tuple[str, ...]:
    """Returns the floor names at positions EVERY meters apart from `a` (2,) to `b` (2,), meters; "" without a name."""
    count = max(1, round(float(np.linalg.norm(b - a)) / EVERY))
    shares = (np.arange(count) + 0.5) / count
    found = layers.values_at(kinds, a + shares[:, None] * (b - a))
    return tuple("" if i == NAMELESS else FLOORS[int(i)] for i in found)


def floors_differ(one: str, other: str) -> bool:
    """Whether two names mean clearly different floors."""
    if RUG in one or RUG in other:
        return one.removesuffix(f" {RUG}") != other.removesuffix(f" {RUG}")
    if one in MATERIALS or other in MATERIALS:
        return one != other and other not in _LIKE.get(one, ()) and one not in _LIKE.get(other, ())
    return are_colors_distinct(one, other)


def _patches(kinds: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Yields the connected patches of floor with one name, with their index into FLOORS."""
    import cv2

    for i in range(len(FLOORS)):
        mask = (kinds == i).astype(np.uint8)
        if mask.any():
            count, labels, sizes, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
            for k in range(1, count):
                if sizes[k, cv2.CC_STAT_AREA] * CELL**2 >= _LEAST:
                    yield i, labels == k


def _lies_on_another(patch: NDArray[np.bool_], kinds: NDArray[np.int64], walls: NDArray[np.bool_]) -> bool:
    """Whether a patch is a rectangle of the size of a rug on another floor, and not a small room."""
    import cv2

    cells = np.argwhere(patch)
    _, sides, _ = cv2.minAreaRect(cells[:, ::-1].astype(np.float32))
    longer, shorter = (max(sides) + 1) * CELL, (min(sides) + 1) * CELL
    if shorter < _SHORTEST or longer > _LONGEST or len(cells) * CELL**2 < _FILLED * longer * shorter:
        return False
    near, far = (
        cv2.dilate(patch.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
        for side in (2 * round(meters / CELL) + 1 for meters in _RING)
    )
    beside, around = near & ~patch, far & ~near
    if not around.any() or walls[beside].mean() > _WALLED:
        return False
    other = around & (kinds != NAMELESS) & (kinds != kinds[patch][0])
    return float(other.sum()) >= _AROUND * float(around.sum())
