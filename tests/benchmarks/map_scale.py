"""Measure map building for a large building: speed of each part, memory, and the effect of kill -9 on the graph.

python -m tests.benchmarks.map_scale [--columns 5] [--rows 3] [--kills 2] [--seed 0] [--folder DIR] [--memory GIB]

Writes a synthetic project of columns x rows furnished halls of 400 m2, one submap each (`large_building`), and runs
`nvsim map` on it in a separate process. A copy of the project is then mapped with `--kills` kills at random times.
Prints one JSON object. Exit code 1 if the graphs differ. `peak_gib` is the peak resident memory of the process
(ru_maxrss). `writing_s` is the time outside of the builder: start, reading of model descriptions, and storage.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from nvsim.graph.store import same_graph
from nvsim.project.project import Project
from tests.benchmarks.harness import json_lines, report
from tests.benchmarks.large_building import write_large_building


@dataclass(frozen=True)
class Arguments:
    columns: int = 5
    rows: int = 3
    kills: int = 2
    seed: int = 0
    folder: Path | None = None
    """Folder for temporary files."""
    memory: float | None = None
    """GiB for trained models, as in `nvsim map --memory`."""


def run_map(project: Path, kill_after: float | None = None, memory: float | None = None) -> dict[str, Any]:
    """The report of `nvsim map` with wall_s, cpu_s, and peak_gib. A killed run has these and the viewpoints found."""
    argv = [sys.executable, "-m", "nvsim", "map", "--project", str(project), "--json"]
    begin = time.perf_counter()
    process = subprocess.Popen(argv + ([f"--memory={memory}"] if memory else []), stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    timer = threading.Timer(kill_after or 0, process.send_signal, [signal.SIGKILL])
    if kill_after is not None:
        timer.start()
    last: dict[str, Any] = {}
    for event in json_lines(process.stdout):
        last = event if event.get("stage") == "map" and event["event"] in ("progress", "done") else last
    _, status, usage = os.wait4(process.pid, 0)
    timer.cancel()
    found = {"wall_s": time.perf_counter() - begin, "cpu_s": usage.ru_utime + usage.ru_stime}
    found["peak_gib"] = usage.ru_maxrss / 2**20
    if status not in (0, signal.SIGKILL):
        raise SystemExit(f"{' '.join(argv)} failed with {status}")
    # A run without remaining work has no event.
    return found | (last["results"] if last.get("event") == "done" else {"viewpoints": last.get("total", 0)})


def measure(folder: Path, columns: int, rows: int, kills: int, seed: int, memory: float | None) -> dict[str, Any]:
    """Runs the benchmark that the module docstring describes. Returns its figures."""
    clean = write_large_building(folder / "quiet" / "building.nvsim", columns, rows)
    # Viewpoint ids depend on the project name.
    twin = folder / "killed" / clean.name
    shutil.copytree(clean, twin)
    quiet = run_map(clean, memory=memory)
    settling, decided = quiet["seconds"] - quiet["search_seconds"], quiet["rendered_viewpoints"]
    figures = {
        "square_metres": 400 * columns * rows,
        "submaps": columns * rows,
        **{name: quiet[name] for name in ("viewpoints", "edges", "rendered_viewpoints", "rendered_views")},
        "viewpoints_per_s": round(decided / quiet["seconds"], 1),
        "search_s": round(quiet["search_seconds"], 1),
        "settling_s": round(settling, 1),
        "writing_s": round(quiet["wall_s"] - quiet["seconds"], 1),
        "wall_s": round(quiet["wall_s"], 1),
        "cpu_s": round(quiet["cpu_s"], 1),
        "peak_gib": round(quiet["peak_gib"], 2),
    }
    rng, fell, again = random.Random(seed), [], 0.0
    for _ in range(kills):
        cut = run_map(twin, rng.uniform(0.2, 0.9) * quiet["wall_s"], memory)
        fell.append(cut["viewpoints"])
    if kills:
        last = run_map(twin, memory=memory)
        again = last.get("rendered_viewpoints", 0)
        with Project.open(clean) as a, Project.open(twin) as b:
            figures["same_graph"] = same_graph(a.need_graph(), b.need_graph())
        figures |= {"killed_at_viewpoints": fell, "last_run_s": round(last["wall_s"], 1), "last_run_rendered": again}
    return figures


def main() -> int:
    a = tyro.cli(Arguments, description=__doc__)
    if a.folder is not None:
        a.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=a.folder) as folder:
        figures = measure(Path(folder), a.columns, a.rows, a.kills, a.seed, a.memory)
    report(figures, as_json=True)
    return 0 if figures.get("same_graph", True) else 1


if __name__ == "__main__":
    sys.exit(main())
