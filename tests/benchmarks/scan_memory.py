"""Measure the memory of exporting many viewpoints: `python tests/benchmarks/scan_memory.py P COUNT [SIDE] [views]`.

The project P is copied. Its graph is replaced by COUNT viewpoints around the existing ones, each connected with its
four nearest. The scan is exported with faces of SIDE pixels (512), and with the 36 views if `views` is given. The
benchmark prints the peak resident memory after a quarter, half, and all of the viewpoints, and at the end.
"""

from __future__ import annotations

import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from nvsim.events import Event, Progress
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project
from nvsim.r2r.observations.export import export_scan
from nvsim.r2r.observations.layout import ScanSettings


def crowded(graph: NavGraph, count: int) -> NavGraph:
    places = np.array([v.position for v in graph.viewpoints.values()])
    r = np.random.default_rng(0)
    places = places[r.integers(0, len(places), count)]
    places[:, :2] += r.uniform(-0.3, 0.3, (count, 2))
    ids = [f"{i:032x}" for i in range(count)]
    near = cKDTree(places).query(places, 5)[1][:, 1:]
    edges = [edge(ids[a], ids[b]) for a, row in enumerate(near) for b in row]
    viewpoints = {id: Viewpoint(id, tuple(map(float, p)), 1.3) for id, p in zip(ids, places)}
    return NavGraph(graph.scan, viewpoints, {e.key: e for e in edges})


def peak() -> float:
    """Peak resident memory of this process, GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20)


def measure(root: Path, count: int, settings: ScanSettings) -> None:
    began = time.process_time()

    def listen(event: Event) -> None:
        if isinstance(event, Progress) and event.total == count and event.done in (count // 4, count // 2, count):
            print(f"{event.done:5} viewpoints: {peak():.3f} GiB, {time.process_time() - began:.0f} s of processor time")

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copytree(root, Path(folder) / root.name, ignore=shutil.ignore_patterns("images", ".writer")))
        with Project.create_or_open(copy) as project:
            project.set_graph(crowded(project.need_graph(), count))
        with Project.open(copy) as project:
            export_scan(project, Path(folder) / "scans", settings=settings, with_stub=False, force=True, listen=listen)
    print(f"at the end, with a visibility matrix of {count} x {count}: {peak():.3f} GiB")


if __name__ == "__main__":
    measure(
        Path(sys.argv[1]),
        int(sys.argv[2]),
        ScanSettings(int(sys.argv[3]) if len(sys.argv) > 3 else 512, views="views" in sys.argv),
    )
