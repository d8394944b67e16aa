"""Names the floor of a storey: a rug, wooden, tiled, or only by its color if its pattern is unclear."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.colour_names import COLOURS, NAMELESS, differ
from nvsim.r2r.surroundings.floor_colours import floor_names
from nvsim.r2r.surroundings.floor_materials import MATERIALS, UNSEEN, floor_materials
from nvsim.r2r.surroundings.layers import CELL, Layers

RUG = "rug"
FLOORS = (*COLOURS, *MATERIALS, *(f"{colour} {RUG}" for colour in COLOURS))
"""Names of floors."""
EVERY = 0.2
"""Meters between the positions at which the floor is sampled."""
_RUGS = ("red", "green", "blue", "purple", "yellow")  # patches of other colors may be shadows or tile patterns
_SHORTEST, _LONGEST, _FILLED = 0.7, 3.5, 0.75  # smallest and largest side of a rug in meters; share of its rectangle
_RING, _AROUND = (0.35, 0.9), 0.5  # ring around a rug, in meters off it, and the share of the ring with another floor
_WALLED = 0.15  # largest share of walls in the cells next to a rug
_MOSTLY, _NEARLY_ALL = 0.5, 0.9  # share of one material in a patch of one color, and in its cells with clear material
_LEAST = 0.5  # square meters that a patch needs
_LIKE = {"wooden": ("brown", "beige", "red", "yellow"), "tiled": ("white", "grey", "black", "beige")}


def floor_kinds(layers: Layers, walls: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns (rows, columns) indices into FLOORS, NAMELESS for unseen or unnamed floor; `walls` (rows, columns)."""
    colours, made_of = floor_names(layers), floor_materials(layers)
    found = np.where(made_of >= 0, made_of + len(COLOURS), colours)
    for _, patch in _patches(colours):
        looks = made_of[patch & (made_of != UNSEEN)]
        sure = np.bincount(looks[looks >= 0], minlength=len(MATERIALS))
        best = int(sure.argmax())
        if sure[best] >= max(_LEAST / CELL**2, _MOSTLY * len(looks), _NEARLY_ALL * sure.sum()):
            found[patch] = len(COLOURS) + best
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
    return differ(one, other)


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
        for side in (2 * round(metres / CELL) + 1 for metres in _RING)
    )
    beside, around = near & ~patch, far & ~near
    if not around.any() or walls[beside].mean() > _WALLED:
        return False
    other = around & (kinds != NAMELESS) & (kinds != kinds[patch][0])
    return float(other.sum()) >= _AROUND * float(around.sum())
