"""Which edges climb: stairs, as no ramp in a building is as steep, and not a threshold."""

from __future__ import annotations

from typing import Literal

Slope = Literal["level", "up", "down"]
_STEEP = 0.25  # metres up per metre of edge, 14 degrees; ramps in buildings have 5
_STEP = 0.15  # metres of a single step, which is no stair


def slope_of(rise: float, metres: float) -> Slope:
    """The slope of an edge of a length `metres` whose end is `rise` metres higher than its beginning."""
    if abs(rise) <= max(_STEEP * metres, _STEP):
        return "level"
    return "up" if rise > 0 else "down"
