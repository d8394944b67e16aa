"""The positions of weak camera poses of a video on its trajectory."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from app.state.document import Document


def weak_spots(document: Document) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """(N,) int64 index of the last frame before each weak part of a video, and a text about each problem."""
    report, capture = document.contents.poses, document.contents.capture
    if report is None or capture is None or not capture.frames:
        return np.zeros(0, np.int64), ()
    names = sorted((frame.name, row) for row, frame in enumerate(capture.frames))
    rows = [names[max(bisect_right(names, (place.first, len(names))) - 1, 0)][1] for place in report.weak]
    words = tuple(f"{place.cause[0].upper()}{place.cause[1:]}. {place.advice.capitalize()}." for place in report.weak)
    return np.array(rows, np.int64), words
