"""Metrics of the Matterport3D graphs, on which agents are trained, for comparison with other graphs."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SOURCE = "the 90 scans of Matterport3DSimulator (commit 589d091)"
MATTERPORT: Mapping[str, float] = MappingProxyType(
    {
        "nodes": 10567,
        "edges": 21468,
        "mean_degree": 4.06,
        "degree_p5": 2.0,
        "degree_p95": 8.0,
        "edge_length": 2.269,
        "edge_length_p5": 0.838,
        "edge_length_p95": 4.305,
        "edge_length_max": 16.798,
        "nearest": 1.315,
        "nearest_mean": 1.377,
        "clustering": 0.433,
        "tied": 0.12595,
        "tied_episodes": 0.04982,
        "near_pairs_1.5": 5589,
        "near_far_1.5": 0.00143,
        "near_pairs_2.5": 14859,
        "near_far_2.5": 0.00922,
    }
)
"""Measured by `nvsim.graph.structure.structure` on every `connectivity/*_connectivity.json` of the source, pooled.
There is no map of these buildings, so near pairs are those that the files mark as `visible`."""
