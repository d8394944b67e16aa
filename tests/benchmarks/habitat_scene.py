"""Compare the navmesh of a scene for Habitat with that of the true map, both built by Recast.

python -m tests.benchmarks.habitat_scene SCENES SCANS SCAN TASKS MAP --modules FOLDER

SCENES is written by `nvsim export habitat`, SCANS by `nvsim export scan`, and TASKS by `nvsim export tasks`. MAP is the
true map.yaml of a built-in building with its floor at z = 0. FOLDER contains the node_modules of
`npm install @recast-navigation/core @recast-navigation/generators`.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from nvsim.cli.terminal import table
from nvsim.dataset.habitat.scene import rectangles
from nvsim.graph.connectivity import read_connectivity
from nvsim.occupancy.read import read_map
from nvsim.occupancy.types import FREE, OccupancyMap
from nvsim.r2r.episodes.episode import in_habitat, scene_id
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.tasks.splitting import SPLITS
from nvsim.r2r.tasks.task import read_tasks
from nvsim.splats.formats.glb import write_colored_glb

_MARGIN = 3.0  # meters around the map


@dataclass(frozen=True)
class Arguments:
    scenes: tyro.conf.Positional[Path]
    scans: tyro.conf.Positional[Path]
    scan: tyro.conf.Positional[str]
    tasks: tyro.conf.Positional[Path]
    map: tyro.conf.Positional[Path]
    modules: Path
    radii: tuple[float, ...] = (0.1, 0.18, 0.25)


def true_mesh(true: OccupancyMap, path: Path) -> None:
    quads = []
    for top, bottom, left, right in rectangles(true.cells == FREE):
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]]) * true.resolution
        quads.append(np.column_stack([corners + true.origin, np.zeros(4)]))
    vertices = np.concatenate(quads)
    first = np.arange(0, len(vertices), 4)[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    write_colored_glb(path, np.array(in_habitat(vertices)), triangles, np.zeros((len(vertices), 3), np.uint8), "truth")


def main() -> None:
    a = tyro.cli(Arguments, description=__doc__)
    graph = read_connectivity(ScanPlaces(a.scans, a.scan).connectivity)
    floors = {id: np.array([*v.position[:2], v.position[2] - v.height]) for id, v in graph.viewpoints.items()}
    tasks = [task for name in SPLITS for task in read_tasks(a.tasks / f"R2R_{name}.json")]
    paths = [in_habitat(np.array([floors[id] for id in task.path])) for task in tasks]
    true = read_map(a.map)
    places = in_habitat(np.column_stack([true.centers().reshape(-1, 2), np.zeros(true.cells.size)]))
    scene = (a.scenes / scene_id(a.scan)).with_name(f"{a.scan}_collision.glb").absolute()
    # Recast's cells begin at the bounds. With other bounds, the true map has an IoU of 0.95 to 0.98 with itself.
    beyond = np.array([[-_MARGIN] * 3, [_MARGIN] * 3])
    bounds = (np.array([np.min(places, axis=0), np.max(places, axis=0)]) + beyond).tolist()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.glb"
        true_mesh(true, truth)
        for radius in a.radii:
            found = {}
            for glb in (truth, scene):
                request: dict[str, Any] = {
                    "glb": str(glb), "bounds": bounds, "radius": radius, "places": places, "paths": paths
                }  # fmt: skip
                script = Path(__file__).with_name("navmesh.mjs")
                done = subprocess.run(
                    ["node", str(script)],
                    input=json.dumps(request),
                    cwd=a.modules,
                    capture_output=True,
                    text=True,
                    check=True,
                )
                found[glb] = json.loads(done.stdout)
            one, other = (np.array(found[glb]["walkable"], bool) for glb in (truth, scene))
            wrong = other & (true.cells != FREE).ravel()
            areas: list[NDArray[np.bool_]] = [one, other, wrong]
            reached = f"{sum(found[scene]['reached'])} of {len(paths)}"
            rows.append(
                (radius, *(f"{mask.sum() * true.resolution**2:.4g}" for mask in areas),
                 f"{(one & other).sum() / (one | other).sum():.3f}", reached)
            )  # fmt: skip
    table(("radius", "true m2", "scene m2", "on obstacles m2", "IoU", "reached paths"), rows)


if __name__ == "__main__":
    main()
