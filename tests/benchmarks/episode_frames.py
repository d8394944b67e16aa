"""Measure how fast the frames of video agents are drawn (`nvsim export dataset --for streamvln`).

python tests/benchmarks/episode_frames.py PROJECT DATASET [--processes 2] [--frames 400]

DATASET is an exported dataset with frames of PROJECT. Each process draws the same frames with one thread and the model
of the first submap, and removes them again. Prints the milliseconds of one thread per frame and step, and the frames
per second of all processes.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numba
import tyro
from harness import report

from nvsim.dataset.frames import read_drawn
from nvsim.files.atomic import write_bytes
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.observations.skybox import as_bytes
from nvsim.render.model import render_model
from nvsim.splats.files import load_model

STEPS = "draw", "encode", "write"


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    dataset: tyro.conf.Positional[Path]
    processes: int = 2
    frames: int = 400


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    if next(arguments.dataset.rglob("frames.json"), None) is None:
        sys.exit(f"{arguments.dataset} has no frames; export it with `nvsim export dataset --for streamvln`.")
    with multiprocessing.get_context("spawn").Pool(arguments.processes) as pool:
        rows = pool.map(partial(draw, arguments), range(arguments.processes), chunksize=1)
    seconds = sum(row["wall"] for row in rows) / len(rows)
    steps = {f"{name}_ms": round(1e3 * sum(row[name] for row in rows) / len(rows), 1) for name in STEPS}
    report({**steps, "frames_per_second": round(arguments.processes / seconds, 1)})


def draw(arguments: Arguments, _: int) -> dict[str, float]:
    """The seconds per frame of each step, and of all by the clock on the wall."""
    numba.set_num_threads(1)
    model = load_model(min((arguments.project / "models").iterdir()))
    records = sorted(arguments.dataset.rglob("frames.json"))
    cameras = [
        drawn.camera(i) for drawn in map(read_drawn, (r.parent for r in records)) for i in range(len(drawn.poses))
    ]
    totals = dict.fromkeys((*STEPS, "wall"), 0.0)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(-3, arguments.frames):  # the first ones load kernels
            if number == 0:
                totals = dict.fromkeys(totals, 0.0)
            clock = [time.thread_time(), time.perf_counter()]
            rgb = render_model(model, cameras[number % len(cameras)], frozenset({"rgb"})).rgb
            assert rgb is not None
            drawn_at = time.thread_time()
            data = jpeg(as_bytes(rgb), 95, whole_chroma=False)
            encoded_at = time.thread_time()
            write_bytes(Path(folder) / f"{max(number, 0):05d}.jpg", data)
            ends = drawn_at, encoded_at, time.thread_time()
            for name, begin, end in zip(STEPS, (clock[0], *ends), ends, strict=False):
                totals[name] += end - begin
            totals["wall"] += time.perf_counter() - clock[1]
    return {name: total / arguments.frames for name, total in totals.items()}


if __name__ == "__main__":
    main()
