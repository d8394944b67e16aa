"""Measure map building for a large building: speed of each part, memory, and the effect of kill -9 on the graph.

python -m tests.benchmarks.map_scale [--columns 5] [--rows 3] [--kills 2] [--seed 0] [--folder DIR] [--memory GIB]

Writes a synthetic project of columns x rows furnished halls of 400 m2, one submap each and runs
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

import numpy as np
import tyro
from numpy.typing import NDArray

from nvsim.benchmarks.map_builder import panel
from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.lens import Lens
from nvsim.graph.store import same_graph
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap
from nvsim.perception.support import FloorSupport
from nvsim.project.project import Project
from nvsim.splats.files import save_model
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.submaps.split import Submap
from tests.benchmarks.harness import json_lines, report

HALL = 20.0  # meters
EYE, _CEILING, _DESK_HEIGHT = 1.4, 2.6, 0.75
_DOOR = 1.2  # meters
_WALL = 0.1  # thickness in the true map, meters
_DESKS = (4.0, 8.0, 12.0, 16.0)  # positions of desk centers in a hall along either axis, meters
_DESK = (1.6, 0.8)
_OVERLAP = 3.0  # meters
_FRAME = 0.25  # meters between two frames
_SPACING = 0.05  # meters between Gaussians

Place = tuple[float, float]


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


def write_large_building(folder: Path, columns: int = 5, rows: int = 3) -> Path:
    """Creates a project of furnished halls of 20 x 20 m in rows, one submap each. Raises InputError if the folder
    contains other files.

    Walls, desks, and a ceiling are regular grids of flat opaque Gaussians at their true positions. The floor has no
    Gaussians, and the known floor is the true one. There are no training and no images. The files, the number of
    Gaussians and their size on disk, the overlaps of submaps, and the trajectory are as in a trained project."""
    path, hall_of = _walk(columns, rows)
    turns = np.arctan2(*np.gradient(path[:, :2], axis=0).T)
    lens = Lens("PINHOLE", 640, 480, (400.0, 400.0, 320.0, 240.0))
    frames = [
        Frame(f"{i:06d}.jpg", Path("/nowhere") / f"{i:06d}.jpg", lens, camera_pose(at, turn, -0.1), timestamp=float(i))
        for i, (at, turn) in enumerate(zip(path, turns.tolist(), strict=True))
    ]
    submaps = []
    for k in range(columns * rows):
        core = np.flatnonzero(hall_of == k)
        low = HALL * np.array([k % columns, k // columns])
        outside = np.maximum(np.maximum(low - path[:, :2], path[:, :2] - low - HALL), 0).max(axis=1)
        seen = np.flatnonzero(outside < _OVERLAP)
        submaps.append(Submap(k, tuple(core.tolist()), tuple(np.union1d(core, seen).tolist()), path[core]))
    truth = _truth(columns, rows)
    with Project.create_or_open(folder) as project:
        capture = Capture(Path("/nowhere"), "nerfstudio", tuple(frames), None, Alignment.identity())
        save_capture(capture, project.layout.imported)
        project.set_submaps(tuple(submaps))
        layout = project.layout
        layout.floor.mkdir(exist_ok=True)
        FloorSupport(truth.cells == FREE, truth.origin, truth.resolution).save(layout.support)
        layout.ground_truth.mkdir(exist_ok=True)
        write_ros_map(truth, layout.ground_truth / "map.yaml")
        for submap in submaps:
            np.savez(layout.surface(submap.index), heights=np.zeros((2, 2), np.float32), origin=(0.0, 0.0), spacing=1.0)
            save_model(_model(submap.index, columns, rows), layout.model(submap.index))
    return folder


def _walk(columns: int, rows: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Camera positions (N, 3) along every aisle of all halls, and (N,) the hall of each."""
    corners: list[Place] = []
    for row in range(rows):
        for n in range(columns):
            column = n if row % 2 == 0 else columns - 1 - n
            inside = [
                (2, 10),
                (2, 2),
                (18, 2),
                (18, 6),
                (2, 6),
                (2, 10),
                (18, 10),
                (18, 14),
                (2, 14),
                (2, 18),
                (18, 18),
            ]
            if n == 0 and row > 0:
                inside = [(10, 0), (10, 2), *inside[1:]]
            inside += [(10, 18), (10, 20)] if n == columns - 1 else [(18, 10), (20, 10)]
            if n == columns - 1 and row == rows - 1:
                inside = inside[:-2]
            for x, y in inside:
                along = x if row % 2 == 0 else HALL - x
                corners.append((column * HALL + along, row * HALL + y))
    parts = []
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        count = max(1, round(float(np.hypot(b[0] - a[0], b[1] - a[1])) / _FRAME))
        parts.append(np.linspace(a, b, count, endpoint=False))
    xy = np.concatenate(parts)
    column, row = (np.clip(xy[:, i] // HALL, 0, n - 1).astype(np.int64) for i, n in enumerate((columns, rows)))
    return np.column_stack([xy, np.full(len(xy), EYE)]), row * columns + column


def _walls(columns: int, rows: int) -> list[tuple[Place, Place]]:
    """Both ends of every wall segment without doors, none longer than a hall."""
    walls = []
    middle, half = HALL / 2, _DOOR / 2
    for across, along, turned in ((columns, rows, False), (rows, columns, True)):
        for i in range(across + 1):
            for j in range(along):
                ends = [(0.0, middle - half), (middle + half, HALL)] if 0 < i < across else [(0.0, HALL)]
                for start, stop in ends:
                    a, b = (HALL * i, HALL * j + start), (HALL * i, HALL * j + stop)
                    walls.append((a[::-1], b[::-1]) if turned else (a, b))
    return walls


def _desks(columns: int, rows: int) -> list[tuple[Place, Place]]:
    """Lower and upper corner of every desk."""
    places = [(HALL * i + x, HALL * j + y) for i in range(columns) for j in range(rows) for x in _DESKS for y in _DESKS]
    w, d = _DESK[0] / 2, _DESK[1] / 2
    return [((x - w, y - d), (x + w, y + d)) for x, y in places]


def _truth(columns: int, rows: int, resolution: float = 0.05) -> OccupancyMap:
    size = round((rows * HALL + 2) / resolution), round((columns * HALL + 2) / resolution)
    cells = np.full(size, OCCUPIED, np.uint8)

    def fill(low: Place, high: Place, value: int) -> None:
        x0, y0, x1, y1 = (round((v + 1) / resolution) for v in (*low, *high))
        cells[y0:y1, x0:x1] = value

    fill((0.0, 0.0), (columns * HALL, rows * HALL), FREE)
    for (ax, ay), (bx, by) in _walls(columns, rows):
        t = _WALL / 2 if ax == bx else 0.0
        s = _WALL / 2 if ay == by else 0.0
        fill((ax - t, ay - s), (bx + t, by + s), OCCUPIED)
    for low, high in _desks(columns, rows):
        fill(low, high, OCCUPIED)
    return OccupancyMap(cells, resolution, (-1.0, -1.0))


def _model(index: int, columns: int, rows: int) -> SubmapModel:
    """The model of a hall, with the objects of other halls within the overlap."""
    low = HALL * np.array([index % columns, index // columns]) - _OVERLAP
    high = low + HALL + 2 * _OVERLAP
    parts = [panel(a, b, _CEILING) for a, b in _walls(columns, rows)]
    for (x0, y0), (x1, y1) in _desks(columns, rows):
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        parts += [panel(p, q, _DESK_HEIGHT) for p, q in zip(corners, corners[1:] + corners[:1], strict=True)]
        parts.append(_level((x0, y0), (x1, y1), _DESK_HEIGHT))
    parts.append(_level((0.0, 0.0), (columns * HALL, rows * HALL), _CEILING))
    kept = [(p[near], q[near]) for p, q in parts if (near := ((p[:, :2] > low) & (p[:, :2] < high)).all(axis=1)).any()]
    means = np.concatenate([p for p, _ in kept]).astype(np.float32)
    quats = np.concatenate([q for _, q in kept]).astype(np.float32)
    scales = np.full((len(means), 3), np.log(0.6 * _SPACING), np.float32)
    scales[:, 2] = np.log(0.004)
    sh = np.random.default_rng(index).uniform(-0.3, 0.3, (len(means), 16, 3)).astype(np.float32)
    gaussians = Gaussians(means, scales, quats, np.full(len(means), 4.0, np.float32), sh)
    info: dict[str, object] = {"gaussians": len(means)}
    return SubmapModel(gaussians, None, None, FloorSurface.flat(0.0), True, info)


def _level(low: Place, high: Place, height: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centers (N, 3) and quaternions (N, 4) of a horizontal panel."""
    x, y = (np.arange(a + _SPACING / 2, b, _SPACING) for a, b in zip(low, high, strict=True))
    xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = np.column_stack([xy, np.full(len(xy), height)])
    return points, np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))


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
