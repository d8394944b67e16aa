"""Browse more models than fit in memory: peak memory and milliseconds per load, as one JSON object.

python tests/benchmarks/scene_memory.py [--submaps N] [--gaussians N] [--limit GIB] [--budget GIB] [--folder DIR]

Writes N submaps of random Gaussians of degree 3 in a row (240 MB per million Gaussians; removed afterward). A separate
process moves along them and back, and renders a view at every step. Its models have a budget of --budget GiB. Its
address space is limited to --limit GiB (RLIMIT_AS), and larger allocations fail, so a finished run respects the limit.
The peaks of resident memory (ru_maxrss) and of address space (VmPeak) are also printed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from harness import peak_gib, report, timed, times

SPACING = 10.0  # meters between the centers of two submaps
STEP = 1.0  # meters between two views


@dataclass(frozen=True)
class Arguments:
    submaps: int = 15
    gaussians: int = 1_000_000
    limit: float = 4.0
    """GiB of address space."""
    budget: float = 2.0
    """GiB of models in memory."""
    folder: Path | None = None
    """Folder for temporary files."""
    ahead: bool = True
    """Load models before they are needed."""
    browse: Path | None = None
    """Browse the models in this folder. The separate process is started with this option."""


def main() -> None:
    options = tyro.cli(Arguments, description=__doc__)
    if options.browse is not None:
        report(browse(options.browse, options.submaps, options.limit, options.budget, options.ahead), as_json=True)
        return
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        _, seconds = timed(lambda: write(Path(folder), options.submaps, options.gaussians))
        print(f"written in {seconds:.0f} s", file=sys.stderr)
        # Without these settings, malloc and OpenMP reserve address space for every core.
        environment = {**os.environ, "MALLOC_ARENA_MAX": "2", "OMP_WAIT_POLICY": "PASSIVE"}
        sys.exit(subprocess.call([sys.executable, __file__, *sys.argv[1:], "--browse", folder], env=environment))


def write(folder: Path, submaps: int, count: int) -> None:
    """Writes the models. Each is a box of Gaussians around (10 i, 0, 1.5)."""
    import numpy as np

    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.splats.files import save_model
    from nvsim.splats.types import Gaussians, SubmapModel

    for i in range(submaps):
        r = np.random.default_rng(i)
        means = (r.random((count, 3), np.float32) - 0.5) * np.float32([SPACING, 8, 3]) + np.float32(
            [SPACING * i, 0, 1.5]
        )
        g = Gaussians(
            means,
            np.full((count, 3), -4.5, np.float32),
            r.standard_normal((count, 4), np.float32),
            np.zeros(count, np.float32),
            0.3 * r.standard_normal((count, 16, 3), np.float32),
        )
        save_model(SubmapModel(g, None, None, FloorSurface.flat(0.0)), folder / str(i))


def browse(folder: Path, submaps: int, limit: float, budget: float, ahead: bool) -> dict[str, object]:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (round(limit * 2**30),) * 2)
    import numpy as np

    from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
    from nvsim.render.scene import render_scene
    from nvsim.splats import scene as scenes
    from nvsim.submaps.split import Submap

    loads: list[float] = []
    load = scenes.load_model

    def measured_load(path: Path):
        model, seconds = timed(lambda: load(path))
        loads.append(1e3 * seconds)
        return model

    scenes.load_model = measured_load
    places = [Submap(i, (i,), (i,), np.array([[SPACING * i, 0.0, 1.5]])) for i in range(submaps)]
    scene = scenes.SceneModel(places, [folder / str(i) for i in range(submaps)], round(budget * 2**30), ahead)
    intrinsics = Intrinsics.from_fov(640, 480, np.radians(70))
    along = np.arange(0, SPACING * (submaps - 1) + STEP / 2, STEP)
    frames, most, seen = [], 0, set()
    for x in (*along, *along[::-1]):
        camera = Camera(intrinsics, camera_pose(np.array([x, 0.3, 1.5]), np.pi / 2))
        frames += times(lambda _, camera=camera: seen.add(render_scene(scene, camera)[0]), 1)
        most = max(most, scene.memory)
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return {
        "submaps": len(seen),
        "limit_gib": limit,
        "budget_gib": budget,
        "peak_rss_gib": round(peak_gib(), 2),
        "peak_address_space_gib": round(int(status["VmPeak"].split()[0]) / 2**20, 2),
        "peak_models_gib": round(most / 2**30, 2),
        "loads": len(loads),
        "load_ms_first": round(float(np.median(loads[:submaps])), 0),
        "load_ms_again": round(float(np.median(loads[submaps:])), 0) if len(loads) > submaps else None,
        "frames": len(frames),
        "frame_ms_median": round(float(np.median(frames)), 1),
        "frame_ms_longest": round(float(np.max(frames[1:])), 0),
    }


if __name__ == "__main__":
    main()
