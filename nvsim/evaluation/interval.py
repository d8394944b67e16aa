"""How sure a share is that was counted."""

from __future__ import annotations

import math

_NORMAL = 1.959963984540054  # the normal distribution lies within so many standard deviations in 95 % of cases


def wilson(part: int, whole: int) -> tuple[float, float]:
    """The 95 % interval of a share of which `part` of `whole` independent cases are; (0, 1) where there is no case.

    Source: Wilson 1927, Probable Inference, the Law of Succession, and Statistical Inference, equation 4.
    """
    if whole <= 0:
        return 0.0, 1.0
    share, z2 = part / whole, _NORMAL**2
    centre = (share + z2 / (2 * whole)) / (1 + z2 / whole)
    half = _NORMAL / (1 + z2 / whole) * math.sqrt(share * (1 - share) / whole + z2 / (4 * whole**2))
    # At the ends the bound is the end itself, whatever the rounding.
    return 0.0 if part == 0 else max(0.0, centre - half), 1.0 if part == whole else min(1.0, centre + half)


def needed(lower: float) -> int:
    """How many cases, all of them right, give an interval that begins at `lower`, between 0 and 1."""
    return math.ceil(_NORMAL**2 * lower / (1 - lower) - 1e-9)
