"""The builder in a furnished house whose map is true and whose walk was driven."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from columns import Columns, flat_floor

from nvsim.benchmarks.map_builder import measure
from nvsim.evaluation.graph import evaluate_graph
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.read import read_map


@pytest.mark.data
def test_house_becomes_one_valid_graph_that_covers_it(shared_data: Path) -> None:
    truth = shared_data / "house_walk" / "ground_truth"
    occupancy = read_map(truth / "map_observed.yaml")
    walk = np.loadtxt(truth / "trajectory_xy_yaw.txt")[:, :2]
    world = Columns(occupancy, noise=0.03)
    positions = np.column_stack([walk, np.full(len(walk), 1.2)])
    config = MappingConfig(view_size=128)
    graph = build_map(world, positions, flat_floor, world.support, config, scan="house").graph
    figures = evaluate_graph(graph, occupancy, walk)
    assert figures["node_validity"] >= 0.99 and figures["edge_validity"] >= 0.99
    assert figures["node_validity_robot"] >= 0.9 and figures["edge_validity_robot"] >= 0.9
    assert figures["coverage"] >= 0.95 and figures["components"] == 1
    degrees = [len(graph.neighbors(id)) for id in graph.viewpoints]
    assert max(degrees) <= 15, "the simulator's sort of neighbours is only stable up to sixteen entries"


def test_benchmark_walks_a_hall_of_gaussians() -> None:
    figures = measure(max_viewpoints=6)
    assert figures["viewpoints"] == 6 and figures["edges"] >= 5
    assert figures["viewpoints_per_s"] > 0
