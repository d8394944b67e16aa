"""Quality of graphs from splats without images, and cost of a large splat.

The models of each trained demo project are joined into one splat, in an arbitrary rotation and scale, and imported as
a file without images. The graph is compared with the true map of the demo, or with the map that --truth names. The
projects are trained once. Preset 3dgs ends with an error of the map stage, which does not matter here. For example:

    nvsim demo --seed 51 --preset 3dgs --project b51.nvsim --no-window
    python -m tests.benchmarks.any_splat b51.nvsim
    python -m tests.benchmarks.any_splat b51.nvsim --formats compressed-ply spz --keep /tmp/kept
    python -m tests.benchmarks.any_splat house.nvsim --truth house.building/ground_truth/map.yaml
    python -m tests.benchmarks.any_splat --gaussians 1000000
"""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from scipy.spatial import cKDTree

from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.truth import maps_in_aligned_frame
from nvsim.graph.paths import components
from nvsim.graph.types import NavGraph
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, RunConfig
from nvsim.project.project import Project
from nvsim.project.stages.imported_splats import imported_storeys
from nvsim.splats.floor_mesh import floor_gaussians
from nvsim.splats.formats.choice import SUFFIXES, Format, write_splats
from nvsim.splats.turning import transform_gaussians
from nvsim.splats.types import Gaussians, joined, select_gaussians
from tests.benchmarks.harness import peak_gib, report, timed
from tests.unit.splat_rooms import any_rotation, two_rooms

SCALE = 0.37


@dataclass(frozen=True)
class Arguments:
    projects: tyro.conf.Positional[tuple[Path, ...]] = ()
    formats: tuple[Format, ...] = ("ply",)
    keep: Path | None = None
    """Folder in which the splats and their projects remain."""
    truth: Path | None = None
    """The true map of projects that are not demos, in the frame of their captures."""
    gaussians: int = 0


def one_splat(project: Project) -> Gaussians:
    """The Gaussians of all submaps. Each Gaussian is that of the submap whose trajectory is nearest."""
    scene = project.scene()
    assert scene is not None
    submaps = [s for s in project.submaps("train") if s.index in scene.indices]
    tree = cKDTree(np.concatenate([s.positions for s in submaps]))
    owner = np.repeat([s.index for s in submaps], [len(s.positions) for s in submaps])
    parts = []
    for submap in submaps:
        submap_model = scene.model(submap.index)
        model, floor = submap_model.baked(), floor_gaussians(submap_model)
        model = model if floor is None else joined(model, floor)
        parts.append(select_gaussians(model, owner[tree.query(model.means)[1]] == submap.index))
    return joined(*parts)


def measure(demo: Path, truth_map: Path | None, folder: Path, seed: int, form: Format) -> dict[str, object]:
    """The figures of one project, exported in the format `form`."""
    with Project.open(demo) as project:
        capture = project.need_capture()
        gaussians = one_splat(project)
        own_map = project.layout.true_map or project.layout.ground_truth
        truth = maps_in_aligned_frame(truth_map or own_map, capture, "source" if truth_map else "aligned")
    rotation = any_rotation(seed)
    source = folder / f"any{SUFFIXES[form]}"
    write_splats(source, transform_gaussians(gaussians, rotation, SCALE), False, form)
    started = time.monotonic()
    graph, storeys, back = build(source, folder / "any.nvsim", 1 / SCALE)
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
    used = time.process_time()
    (graph, _, _), seconds = timed(lambda: build(folder / "large.ply", folder / "large.nvsim", 1.0))
    return {
        "gaussians": count,
        "viewpoints": len(graph.viewpoints),
        "components": len(components(graph)),
        "seconds": round(seconds, 1),
        "cpu_seconds": round(time.process_time() - used, 1),
        "peak_GiB": round(peak_gib(), 2),
    }


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    for seed, demo in enumerate(arguments.projects):
        for form in arguments.formats:
            with tempfile.TemporaryDirectory() as temporary:
                folder = arguments.keep / f"{demo.stem}-{form}" if arguments.keep else Path(temporary)
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir(parents=True)
                report(
                    {"project": demo.name, "format": form, **measure(demo, arguments.truth, folder, seed, form)},
                    as_json=True,
                )
    if arguments.gaussians:
        with tempfile.TemporaryDirectory() as folder:
            report(large(arguments.gaussians, Path(folder)), as_json=True)


if __name__ == "__main__":
    main()
