"""The measurement of depth walks through the built-in building, at a size that a test has time for."""

from __future__ import annotations

from nvsim.benchmarks.depth import measure
from nvsim.building.config import BuildingConfig
from nvsim.depth.config import DepthConfig


def test_it_says_what_a_frame_costs_and_at_which_size() -> None:
    building = BuildingConfig(size="small", width=96, height=72, people=False)
    figures = measure(5, DepthConfig(longest_side=64, planes=24), building)
    assert figures["frames"] == 5 and figures["size"] == "64x48" and figures["threads"] == 2
    assert 0 < figures["ms_per_frame"] < 20_000
