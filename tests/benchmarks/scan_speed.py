"""Measure the processor seconds of each part of a viewpoint's export.

python tests/benchmarks/scan_speed.py PROJECT [COUNT]

The figures are medians over COUNT viewpoints (8), after one that warms up the caches. NUMBA_NUM_THREADS sets the number
of threads.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from nvsim.geometry.directions import sweep
from nvsim.project.project import Project
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings
from nvsim.r2r.observations.record import write_part
from nvsim.r2r.observations.skybox import Images, as_bytes, encode_images, focal_of, skybox_of
from nvsim.r2r.observations.surround import draw_surround


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    count: tyro.conf.Positional[int] = 8


def measure(project: Project, count: int) -> None:
    scene, viewpoints = project.scene(), list(project.need_graph().viewpoints.values())
    settings, rows = ScanSettings(views=True), []
    with tempfile.TemporaryDirectory() as folder:
        for v in viewpoints[: count + 1]:
            at, clock = np.array(v.position), [time.process_time()]
            model = scene.model_at(at)[1]
            surround = draw_surround(model, at, focal_of(settings.size))
            clock.append(time.process_time())
            strip = skybox_of(surround, model.floor, settings.size)
            clock.append(time.process_time())
            views = [as_bytes(surround.colour(camera)) for camera in sweep(at)]
            clock.append(time.process_time())
            places = ScanPlaces(Path(folder), "scan")
            files = encode_images(Images(strip, views), v, settings, places)
            clock.append(time.process_time())
            write_part(places.root, files, "")
            clock.append(time.process_time())
            rows.append(np.diff(clock))
    names = ("draw narrow views", "sample faces and depth", "sample 36 views", "encode", "hash and write")
    for name, seconds in zip(names, np.median(rows[1:], axis=0)):
        print(f"{name:24} {seconds:.2f} s")
    print(f"{'all':24} {np.median(np.sum(rows[1:], axis=1)):.2f} s")


if __name__ == "__main__":
    arguments = tyro.cli(Arguments, description=__doc__)
    with Project.open(arguments.project) as opened:
        measure(opened, arguments.count)
