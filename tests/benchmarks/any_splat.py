"""Quality of graphs from splats without images, and cost of a large splat.

For each demo project, its models are exported in an arbitrary rotation and scale and imported as a splat file without
images. The graph is compared with the true map of the demo. Run, for example:

    nvsim demo --small --seed 32 --preset 3dgs --project small.nvsim --no-window
    python -m tests.benchmarks.any_splat small.nvsim
    python -m tests.benchmarks.any_splat --gaussians 1000000
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.truth import maps_in_aligned_frame
from nvsim.graph.paths import components
from nvsim.graph.types import NavGraph
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, RunConfig
from nvsim.project.project import Project
from nvsim.project.stages.imported_splats import imported_storeys
from nvsim.splats.formats.choice import write_splats
from nvsim.splats.turning import turned
from nvsim.splats.types import Gaussians
from tests.unit.splat_rooms import any_rotation, joined, two_rooms

SCALE = 0.37


def measure(demo: Path, folder: Path, seed: int) -> dict[str, object]:
    """The figures of one demo project."""
    with Project.open(demo) as project:
        scene, capture = project.scene(), project.need_capture()
        assert scene is not None
        gaussians = joined(*(scene.model(index).baked() for index in scene.indices))
        truth = maps_in_aligned_frame(project.layout.true_map or project.layout.ground_truth, capture, "aligned")
    rotation = any_rotation(seed)
    write_splats(folder / "any.ply", turned(gaussians, rotation, SCALE), False, "ply")
    started = time.monotonic()
    graph, storeys, back = build(folder / "any.ply", folder / "any.nvsim", 1 / SCALE)
    to_demo = rotation.T @ back
    moved = {
        id: replace(v, position=tuple(map(float, to_demo @ v.position)), included=v.included)
        for id, v in graph.viewpoints.items()
    }
    figures = evaluate_graph(NavGraph(graph.scan, moved, graph.edges), truth, capture.positions)
    names = (
        "nodes",
        "edges",
        "node_validity",
        "edge_validity",
        "node_validity_robot",
        "edge_validity_robot",
        "coverage",
    )
    up = to_demo @ [0.0, 0.0, 1.0]
    return {
        "up_degrees": round(float(np.degrees(np.arccos(min(1.0, up[2])))), 3),
        "floors_m": [round(z, 3) for z in storeys],
        "components": len(components(graph)),
        **{name: figures[name] for name in names},
        "seconds": round(time.monotonic() - started, 1),
    }


def build(source: Path, root: Path, scale: float | None) -> tuple[NavGraph, list[float], np.ndarray]:
    """The graph of a splat file, the heights of its floors, and the rotation from its frame to that of the file."""
    with Project.create_or_open(root) as project:
        pipeline.run(project, source, CaptureConfig(scale=scale), RunConfig())
        return project.need_graph(), imported_storeys(project)[0], project.need_capture().alignment.rotation.T


def large(count: int, folder: Path) -> dict[str, object]:
    """Cost of a synthetic splat of `count` Gaussians on 12 pairs of rooms, 490 m²."""
    rooms = [two_rooms() for _ in range(12)]
    for k, room in enumerate(rooms):
        room.means[:, :2] += np.float32([8.1 * (k % 3), 5.0 * (k // 3)])
    whole = joined(*rooms)
    copies = -(-count // len(whole))
    noise = np.random.default_rng(0).normal(0, 0.02, (copies * len(whole), 3)).astype(np.float32)
    parts = (np.concatenate([array] * copies)[:count] for array in vars(whole).values())
    gaussians = Gaussians(*parts)
    gaussians.means[:, :2] += noise[:count, :2]
    write_splats(folder / "large.ply", gaussians, False, "ply")
    started = time.monotonic()
    graph, _, _ = build(folder / "large.ply", folder / "large.nvsim", 1.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    seconds = round(time.monotonic() - started, 1)
    return {"gaussians": count, "viewpoints": len(graph.viewpoints), "seconds": seconds, "peak_GiB": round(peak, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("projects", nargs="*", type=Path)
    parser.add_argument("--gaussians", type=int, default=0)
    arguments = parser.parse_args()
    for seed, demo in enumerate(arguments.projects):
        with tempfile.TemporaryDirectory() as folder:
            print(demo.name, measure(demo, Path(folder), seed))
    if arguments.gaussians:
        with tempfile.TemporaryDirectory() as folder:
            print(large(arguments.gaussians, Path(folder)))


if __name__ == "__main__":
    main()
