"""Classify edges as level or climbing. Only stairs count as climbing, not ramps or door thresholds."""

from __future__ import annotations

from typing import Literal

Slope = Literal["level", "up", "down"]
_STEEP = 0.25  # rise per meter of edge, 14 degrees; ramps in buildings have 5 degrees
_STEP = 0.15  # meters: rise of a single step, which does not count as stairs


def slope_of(rise: float, metres: float) -> Slope:
    """Return the slope of an edge of `metres` meters whose end is `rise` meters higher than its beginning."""
    if abs(rise) <= max(_STEEP * metres, _STEP):
        return "level"
    return "up" if rise > 0 else "down"
