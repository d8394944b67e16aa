"""Names of colors, only for colors whose name is undisputed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLOURS = ("white", "grey", "black", "red", "brown", "beige", "yellow", "green", "blue", "purple")
NAMELESS = -1
_NEUTRAL = frozenset(("white", "grey", "black"))
# Ranges of CIELAB hue in degrees, lightness, and chroma. Colors outside all ranges have no name.
_RANGES: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "white": ((0, 360), (82, 101), (0, 9)),
    "grey": ((0, 360), (38, 68), (0, 6)),
    "black": ((0, 360), (0, 24), (0, 9)),
    "red": ((5, 41), (20, 62), (21, 200)),
    "brown": ((50, 84), (18, 57), (14, 60)),
    "beige": ((60, 96), (66, 90), (12, 34)),
    "yellow": ((84, 105), (60, 100), (45, 200)),
    "green": ((108, 172), (18, 85), (16, 200)),
    "blue": ((232, 292), (15, 75), (14, 200)),
    "purple": ((314, 340), (15, 75), (16, 200)),  # in CIELAB, blue has hue 306
}


def lab_of(colours: NDArray[np.floating]) -> NDArray[np.float32]:
    """Converts sRGB colors (..., 3) from 0 to 255 to CIELAB (..., 3) float32."""
    import cv2

    flat = (np.asarray(colours, np.float32) / np.float32(255)).reshape(-1, 1, 3)
    return np.asarray(cv2.cvtColor(flat, cv2.COLOR_RGB2Lab).reshape(np.shape(colours)), np.float32)


def names_of(lab: NDArray[np.floating]) -> NDArray[np.int64]:
    """Returns (...) int64 indices into COLOURS for CIELAB colors (..., 3), NAMELESS if the name is disputable."""
    light, chroma = lab[..., 0], np.hypot(lab[..., 1], lab[..., 2])
    hue = np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360
    found = np.full(light.shape, NAMELESS, np.int64)
    for i, name in enumerate(COLOURS):
        hues, lights, chromas = _RANGES[name]
        inside = [(low <= value) & (value < high) for value, (low, high) in
                  ((hue, hues), (light, lights), (chroma, chromas))]  # fmt: skip
        found[inside[0] & inside[1] & inside[2]] = i
    return found


def differ(one: str, other: str) -> bool:
    """Whether two color names cannot be confused by light and shadow."""
    if one == other or {one, other} in ({"brown", "beige"}, {"white", "beige"}, {"red", "brown"}, {"beige", "yellow"}):
        return False
    return not {one, other} <= _NEUTRAL or {one, other} == {"white", "black"}
