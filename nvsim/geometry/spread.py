"""Choose a sample of indices, evenly spread from the first to the last."""

from __future__ import annotations

import numpy as np


def spread(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to `count` - 1, ascending, including the first and the last. Empty if
    `count` is 0."""
    if count == 0:
        return []
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).round())]
