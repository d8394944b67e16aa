"""Names of objects: their shape by size, heights and spread of colors, and their color if it is undisputed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.layers import CELL

COLORS = ("white", "gray", "black", "red", "brown", "beige", "yellow", "green", "blue", "purple")
NAMELESS = -1
_NEUTRAL = frozenset(("white", "gray", "black"))
# Ranges of CIELAB hue in degrees, lightness, and chroma. Colors outside all ranges have no name.
_RANGES: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "white": ((0, 360), (82, 101), (0, 9)),
    "gray": ((0, 360), (38, 68), (0, 6)),
    "black": ((0, 360), (0, 24), (0, 9)),
    "red": ((5, 41), (20, 62), (21, 200)),
    "brown": ((50, 84), (18, 57), (14, 60)),
    "beige": ((60, 96), (66, 90), (12, 34)),
    "yellow": ((84, 105), (60, 100), (45, 200)),
    "green": ((108, 172), (18, 85), (16, 200)),
    "blue": ((232, 292), (15, 75), (14, 200)),
    "purple": ((314, 340), (15, 75), (16, 200)),  # in CIELAB, blue has hue 306
}


def lab_of(colors: NDArray[np.floating]) -> NDArray[np.float32]:
    """Converts sRGB colors (..., 3) from 0 to 255 to CIELAB (..., 3) float32."""
    import cv2

    flat = (np.asarray(colors, np.float32) / np.float32(255)).reshape(-1, 1, 3)
    return np.asarray(cv2.cvtColor(flat, cv2.COLOR_RGB2Lab).reshape(np.shape(colors)), np.float32)


def names_of(lab: NDArray[np.floating]) -> NDArray[np.int64]:
    """Returns (...) int64 indices into COLORS for CIELAB colors (..., 3), NAMELESS if the name is disputable."""
    light, chroma = lab[..., 0], np.hypot(lab[..., 1], lab[..., 2])
    hue = np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360
    found = np.full(light.shape, NAMELESS, np.int64)
    for i, name in enumerate(COLORS):
        hues, lights, chromas = _RANGES[name]
        inside = [(low <= value) & (value < high) for value, (low, high) in
                  ((hue, hues), (light, lights), (chroma, chromas))]  # fmt: skip
        found[inside[0] & inside[1] & inside[2]] = i
    return found


def are_colors_distinct(one: str, other: str) -> bool:
    """Whether two color names cannot be confused by light and shadow."""
    if one == other or {one, other} in ({"brown", "beige"}, {"white", "beige"}, {"red", "brown"}, {"beige", "yellow"}):
        return False
    return not {one, other} <= _NEUTRAL or {one, other} == {"white", "black"}


Shape = Literal[
    "chair", "plant", "sofa", "desk", "table", "low table", "bookshelf", "cabinet", "box", "platform", "tall",
    "waist-high", "low", "object",
]  # fmt: skip
VAGUE: tuple[Shape, ...] = ("tall", "waist-high", "low", "object")
"""Shapes without a name of a thing."""
TALL, WAIST, FLAT = 1.45, 0.66, 0.26
"""Heights of the top in meters: of a tall and of a waist-high piece of furniture, and the largest of a platform."""
_FURNITURE = 1.3  # smallest longer side in meters of a piece of furniture without a better name
_LEGS = 0.12  # largest share of a table's rim that legs close
_EVEN = 0.75  # smallest share of a table's cells at the height of its top
_MIXED = 5.0  # CIELAB b: larger standard deviations are colors of several things, such as books
_WOODS = ("brown", "beige")


@dataclass(frozen=True, eq=False)
class Outline:
    """The measured form of an object.

    cells               (n, 2) columns and rows
    tops                (n,) meters above the floor, the highest voxel of each cell
    lowest              (n,) meters above the floor, the lowest voxel of each cell
    top                 meters above the floor
    longer, shorter     sides in meters
    only_front_visible  whether possibly only its front is seen
    color               its name in COLORS
    color_share         share of its voxels that have this color
    color_start         meters above the floor where this color begins
    spread              standard deviation of CIELAB b between bottom and top
    """

    cells: NDArray[np.int32]
    tops: NDArray[np.float64]
    lowest: NDArray[np.float64]
    top: float
    longer: float
    shorter: float
    only_front_visible: bool
    color: str
    color_share: float
    color_start: float
    spread: float

    @property
    def fill(self) -> float:
        """Share of its rectangle that it covers."""
        return len(self.cells) * CELL * CELL / (self.longer * self.shorter)

    @property
    def level(self) -> float:
        return float(np.median(self.tops))

    @property
    def flat_top_share(self) -> float:
        """Share of cells whose top is at the median height."""
        return float((np.abs(self.tops - self.level) < 0.09).mean())

    @property
    def rim_share(self) -> float:
        """Share of the rim in which a side below the edge is seen."""
        return float((self.lowest < self.level - 0.2)[_is_rim(self.cells)].mean())

    @property
    def grounded_share(self) -> float:
        """Share of the rim in which a side just above the floor is seen."""
        return float((self.lowest < FLAT)[_is_rim(self.cells)].mean())

    def share_of_tops(self, low: float, high: float) -> float:
        """Share of cells with a top between two heights in meters."""
        return float(((self.tops > low) & (self.tops < high)).mean())


def shape_of(o: Outline) -> Shape | None:
    """Returns the shape of an object, or None if it has no reliable form."""
    if o.fill < 0.4 and not o.only_front_visible and not _is_plant(o):
        return None  # scattered or L-shaped
    if o.level < FLAT:
        alike = float((o.tops < FLAT).mean())
        is_stage = alike > 0.85 and o.longer * o.shorter > 0.8 and o.fill > 0.6 and o.longer > 1.2
        return "platform" if is_stage else None
    for shape, fits in (("chair", _is_chair), ("plant", _is_plant), ("sofa", _is_sofa), ("box", _is_box)):
        if fits(o):
            return shape  # type: ignore[return-value]
    return _table(o) or _storage(o) or _by_height(o)


def _is_chair(o: Outline) -> bool:
    small = o.shorter >= 0.35 and o.longer <= 0.7 and 0.75 < o.top < 1.1
    return small and o.share_of_tops(0.36, 0.58) >= 0.5 and 0.08 <= o.share_of_tops(0.6, 1.1) <= 0.45


def _is_plant(o: Outline) -> bool:
    """Whether it is green leaves above a pot, which has another color or is narrower."""
    return (
        o.color == "green"
        and o.longer <= 2.0
        and o.top > 0.7
        and o.color_start > 0.25
        and o.share_of_tops(0.6, 3.0) > 0.7
    )


def _is_sofa(o: Outline) -> bool:
    size = o.color not in _WOODS and o.longer > 1.4 and o.shorter > 0.6 and o.top < 1.05
    return size and o.share_of_tops(0.28, 0.56) > 0.3 and o.share_of_tops(0.6, 2.0) > 0.15


def _is_box(o: Outline) -> bool:
    """Whether it is one or more cartons: wood-colored, small, and closed down to the floor."""
    size = o.color in _WOODS and o.longer <= 1.0 and 0.5 < o.top < 0.8 and o.color_share > 0.65
    return size and o.shorter > 0.2 and o.grounded_share > 0.4


def _table(o: Outline) -> Shape | None:
    if o.shorter <= 0.4 or o.longer < 0.7:
        return None
    if o.flat_top_share > _EVEN and o.rim_share < _LEGS:
        return "low table" if 0.3 < o.level < 0.56 else "table" if 0.56 < o.level < 0.85 else None
    is_desk = o.color in _WOODS and 0.66 < o.level < 0.8 and o.longer >= 1.0 and o.shorter > 0.45
    return "desk" if is_desk and o.flat_top_share > 0.7 and o.grounded_share < 0.4 else None


def _storage(o: Outline) -> Shape | None:
    """Names pieces that reach the floor: mixed colors in a wooden body are a bookshelf, an even front is a cabinet."""
    if o.color not in _WOODS or o.flat_top_share < 0.55 or o.shorter > 0.6 or not 0.7 <= o.longer <= 2.2 or o.top < 0.8:
        return None
    if o.color_share < 0.7 and o.spread > _MIXED:
        return "bookshelf"
    return "cabinet" if o.color_share > 0.75 and o.spread < _MIXED and o.rim_share > 0.3 and o.top < TALL else None


def _by_height(o: Outline) -> Shape | None:
    if o.longer < _FURNITURE or o.color == "green":  # bushes are not furniture
        return "object" if o.top > 0.5 else None
    return "tall" if o.top >= TALL else "waist-high" if o.top >= WAIST else "low"


def _is_rim(cells: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Returns (n,) whether cells (n, 2) have a neighbor outside the object."""
    keys = cells[:, 0].astype(np.int64) << 32 | cells[:, 1]
    around = [np.isin(keys + step, keys) for step in (1, -1, 1 << 32, -(1 << 32))]
    return ~np.logical_and.reduce(around)
