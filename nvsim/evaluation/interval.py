"""How sure a share is that was counted, and a mean."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_NORMAL = 1.959963984540054  # the normal distribution lies within so many standard deviations in 95 % of cases


def wilson(part: float, whole: float) -> tuple[float, float]:
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


def grouped_mean(values: NDArray[np.float64], groups: NDArray[np.integer]) -> tuple[float, float]:
    """The 95 % interval of the mean of `values` (n,), of which those of one group (n,) are not independent of each
    other; without an end where there are fewer than two groups.

    Source: Liang and Zeger 1986, Longitudinal data analysis using generalized linear models, for a mean.
    """
    if len(np.unique(groups)) < 2:
        return -math.inf, math.inf
    mean, half = float(values.mean()), _NORMAL * math.sqrt(_variance(values, groups))
    return mean - half, mean + half


def grouped_share(cases: NDArray[np.float64], groups: NDArray[np.integer]) -> tuple[float, float]:
    """`wilson` of `cases` (n,) of 0 and 1, of which those of one group (n,) are not independent of each other: of as
    many independent cases as would leave the share as unsure (Kish 1965, Survey Sampling, section 8.2).

    Where all cases are alike there are as many as groups."""
    count, parts = len(cases), len(np.unique(groups))
    share = float(cases.mean()) if count else 0.0
    whole = float(parts)
    if 0 < share < 1 and parts > 1:
        spread = _variance(cases, groups)
        whole = min(float(count), share * (1 - share) / spread) if spread > 0 else float(count)
    return wilson(share * whole, whole)


def _variance(values: NDArray[np.float64], groups: NDArray[np.integer]) -> float:
    """Of the mean, over two groups or more."""
    _, group = np.unique(groups, return_inverse=True)
    sums = np.bincount(group.ravel(), values - values.mean())
    return float((sums**2).sum() / len(values) ** 2 * len(sums) / (len(sums) - 1))


def needed(lower: float) -> int:
    """How many cases, all of them right, give an interval that begins at `lower`, between 0 and 1."""
    return math.ceil(_NORMAL**2 * lower / (1 - lower) - 1e-9)
