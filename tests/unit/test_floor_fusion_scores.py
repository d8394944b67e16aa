"""The scores that the benchmark of floor masks prints."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.floor_fusion import scores


def test_frames_without_floor_have_their_own_score() -> None:
    half = np.arange(100) < 50
    little, none = np.arange(100) < 4, np.zeros(100, bool)
    assert scores([(half, half), (little, none), (none, none)]) == ("1.000", "1.000", "1.000", "0.020")


def test_without_such_frames_and_without_counted_pixels_the_score_is_empty() -> None:
    half, empty = np.arange(100) < 50, np.zeros(0, bool)
    quarter = np.arange(100) < 25
    assert scores([(half, quarter), (empty, empty)]) == ("0.500", "0.500", "1.000", "")
