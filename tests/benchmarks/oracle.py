"""Measure map building without rendering: the builder with a perfect oracle for its criteria.

python -m tests.benchmarks.oracle [--seeds 41 42 43 --truth FOLDER ...] [--json]

The oracle answers from the true occupancy map like a perfect floor-aware model. Alpha is 1 at obstacles, and free space
is known floor. The remaining errors come from the lattice, the settling, and the raster of views and map. A seed is a
generated building, of which nothing is rendered. --truth names folders with map.yaml and trajectory_xy_yaw.txt, like
the ground_truth folder of house_walk.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from nvsim.building import BuildingConfig
from nvsim.building.scene import make_scene
from nvsim.building.truth import occupancy
from nvsim.evaluation.graph import evaluate_graph
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.read import read_map
from nvsim.occupancy.types import OccupancyMap
from tests.benchmarks.harness import report_columns, timed

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))

CAMERA_HEIGHT = 1.4  # meters
_SHOWN = (
    *("nodes", "edges", "node_validity", "edge_validity", "node_validity_robot", "edge_validity_robot", "coverage"),
    *("components", "mean_degree", "clustering", "nearest", "near_far", "tied", "tied_episodes"),
    *("detour", "detour_p95", "rendered_views", "seconds"),
)


@dataclass(frozen=True)
class Arguments:
    seeds: tuple[int, ...] = (41, 42, 43)
    truth: tuple[Path, ...] = ()
    json: bool = False
    config: tyro.conf.OmitArgPrefixes[MappingConfig] = field(default_factory=MappingConfig)


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    worlds = {str(folder): of_folder(folder) for folder in arguments.truth}
    worlds |= {f"seed {seed}": of_seed(seed) for seed in arguments.seeds}
    figures = {name: measured(*world, arguments.config) for name, world in worlds.items()}
    report_columns(figures, _SHOWN, "a perfect oracle", arguments.json)


def of_folder(folder: Path) -> tuple[OccupancyMap, NDArray[np.float64]]:
    """The true map of a folder, and the trajectory (N, 2), meters."""
    return read_map(folder / "map.yaml"), np.loadtxt(folder / "trajectory_xy_yaw.txt")[:, :2]


def of_seed(seed: int) -> tuple[OccupancyMap, NDArray[np.float64]]:
    """The true map of a generated building, and the trajectory (N, 2), meters."""
    scene = make_scene(BuildingConfig(seed=seed))
    return occupancy(scene), scene.path[:, :2]


def mapped(
    occupancy: OccupancyMap, walk: NDArray[np.float64], config: MappingConfig, scan: str = "oracle"
) -> BuildResult:
    """The map that the builder makes for the trajectory `walk` (N, 2) in meters."""
    from columns import Columns, flat_floor

    world = Columns(occupancy)
    cameras = np.column_stack([walk, np.full(len(walk), CAMERA_HEIGHT)])
    return build_map(world, cameras, flat_floor, world.support, config, scan=scan)


def measured(occupancy: OccupancyMap, walk: NDArray[np.float64], config: MappingConfig) -> dict[str, Any]:
    """Metrics of `nvsim evaluate graph` for the trajectory `walk` (N, 2) in meters, and the cost of the build."""
    result, seconds = timed(lambda: mapped(occupancy, walk, config))
    found = evaluate_graph(result.graph, occupancy, walk)
    return {**found, "rendered_views": result.report["rendered_views"], "seconds": round(seconds, 1)}


if __name__ == "__main__":
    main()
