"""Print as JSON the speed of writing and reading a PLY file of Gaussians, and the peak memory relative to the arrays.

Run: python tests/benchmarks/ply_memory.py [COUNT]"""

from __future__ import annotations

import statistics
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import tyro
from harness import report, timed

from nvsim.splats.ply import read_ply, write_ply
from nvsim.splats.types import Gaussians

RUNS = 5


@dataclass(frozen=True)
class Arguments:
    count: tyro.conf.Positional[int] = 1_000_000


def measured(work):
    """Median seconds of RUNS runs, and the largest growth of resident memory in bytes, sampled every 2 ms."""
    process, seconds, most = psutil.Process(), [], 0
    for _ in range(RUNS):
        before, stop = process.memory_info().rss, threading.Event()
        peak = [before]

        def watch(peak=peak, stop=stop):
            while not stop.wait(0.002):
                peak[0] = max(peak[0], process.memory_info().rss)

        watcher = threading.Thread(target=watch)
        watcher.start()
        result, taken = timed(work)
        seconds.append(taken)
        stop.set()
        watcher.join()
        most = max(most, peak[0] - before)
        del result
    return statistics.median(seconds), most


def main() -> None:
    count = tyro.cli(Arguments, description=__doc__).count
    r = np.random.default_rng(0)
    shapes = (count, 3), (count, 3), (count, 4), (count,), (count, 16, 3)
    gaussians = Gaussians(*(r.standard_normal(shape, np.float32) for shape in shapes))
    arrays = 4 * 59 * count
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.ply"
        writing, written = measured(lambda: write_ply(path, gaussians, True))
        reading, held = measured(lambda: read_ply(path))
        size = path.stat().st_size
    figures = {
        "gaussians": count,
        "file_mb": round(size / 1e6, 1),
        "write_mb_per_s": round(size / 1e6 / writing),
        "write_peak_of_arrays": round(written / arrays, 3),
        "read_mb_per_s": round(size / 1e6 / reading),
        "read_peak_of_arrays": round(held / arrays, 3),
    }
    report(figures, as_json=True)


if __name__ == "__main__":
    main()
