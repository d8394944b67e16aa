"""Confidence intervals of a counted share and of a mean."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_NORMAL = 1.959963984540054  # 95 % of a normal distribution are within so many standard deviations


def wilson(part: float, whole: float) -> tuple[float, float]:
    """The 95 % confidence interval of a share: `part` of `whole` independent cases. (0, 1) if there are no cases.

    Source: Wilson 1927, Probable Inference, the Law of Succession, and Statistical Inference, equation 4.
    """
    if whole <= 0:
        return 0.0, 1.0
    share, z2 = part / whole, _NORMAL**2
    center = (share + z2 / (2 * whole)) / (1 + z2 / whole)
    half = _NORMAL / (1 + z2 / whole) * math.sqrt(share * (1 - share) / whole + z2 / (4 * whole**2))
    # At the ends the bound is exactly 0 or 1, independent of rounding.
    return 0.0 if part == 0 else max(0.0, center - half), 1.0 if part == whole else min(1.0, center + half)


def grouped_mean(values: NDArray[np.float64], groups: NDArray[np.integer]) -> tuple[float, float]:
    """The 95 % confidence interval of the mean of `values` (n,). Values of one group (n,) may depend on each other. The
    interval is infinite if there are fewer than two groups.

    Source: Liang and Zeger 1986, Longitudinal data analysis using generalized linear models, for a mean.
    """
    if len(np.unique(groups)) < 2:
        return -math.inf, math.inf
    mean, half = float(values.mean()), _NORMAL * math.sqrt(_variance(values, groups))
    return mean - half, mean + half


def grouped_share(cases: NDArray[np.float64], groups: NDArray[np.integer]) -> tuple[float, float]:
    """`wilson` of `cases` (n,) of 0 and 1, where cases of one group (n,) may depend on each other. It uses the number
    of independent cases that would give an equal variance (Kish 1965, Survey Sampling, section 8.2).

    If all cases are equal, this is the number of groups."""
    count, parts = len(cases), len(np.unique(groups))
    share = float(cases.mean()) if count else 0.0
    whole = float(parts)
    if 0 < share < 1 and parts > 1:
        spread = _variance(cases, groups)
        whole = min(float(count), share * (1 - share) / spread) if spread > 0 else float(count)
    return wilson(share * whole, whole)


def _variance(values: NDArray[np.float64], groups: NDArray[np.integer]) -> float:
    """The variance of the mean, over two or more groups."""
    _, group = np.unique(groups, return_inverse=True)
    sums = np.bincount(group.ravel(), values - values.mean())
    return float((sums**2).sum() / len(values) ** 2 * len(sums) / (len(sums) - 1))


def cases_needed(lower: float) -> int:
    """Number of cases, all of them successes, that gives an interval with the lower end `lower`, between 0 and 1."""
    return math.ceil(_NORMAL**2 * lower / (1 - lower) - 1e-9)
