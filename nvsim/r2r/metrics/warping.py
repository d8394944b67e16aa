"""Dynamic time warping of many pairs of paths in one batch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def warped(
    cost: NDArray[np.float64],  # (B, P, R) meters between step p of a trajectory and step r of its reference
    steps: NDArray[np.int64],  # (B,) number of valid steps in P, 1 or more
    reference: NDArray[np.int64],  # (B,) number of valid steps in R, 1 or more
) -> NDArray[np.float64]:
    """Returns (B,) the smallest sum of costs over the monotone alignments of both paths, each from end to end.

    Source: Ilharco et al. 2019, General Evaluation for Instruction Conditioned Navigation, section 4.
    """
    pairs, most, width = cost.shape
    found = np.zeros(pairs)
    row = np.full((pairs, width + 1), np.inf)
    row[:, 0] = 0.0
    for p in range(most):
        above, row = row, np.full((pairs, width + 1), np.inf)
        diagonal_or_above = np.minimum(above[:, :-1], above[:, 1:])
        for r in range(width):
            row[:, r + 1] = cost[:, p, r] + np.minimum(diagonal_or_above[:, r], row[:, r])
        ends = np.flatnonzero(steps == p + 1)
        found[ends] = row[ends, reference[ends]]
    return found
