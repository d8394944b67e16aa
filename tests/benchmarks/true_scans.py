"""Create scans of many built-in buildings without reconstruction, for the training of agents.

python -m tests.benchmarks.true_scans OUT [--seeds 101 102 ...] [--width 160]

The graph comes from the map builder with a perfect oracle for its criteria. The 36 views of each viewpoint are
ray-traced from the building. Writes `connectivity/` and `views/` in the layout of `nvsim export scan`, with scans named
B101 and so on. Existing scans are kept. The views are sharper than any reconstruction, and no edge is false, so a scan
of a project is harder for agents.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import tyro

from nvsim.building import BuildingConfig
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene, textures_of
from nvsim.building.truth import occupancy
from nvsim.files import atomic
from nvsim.geometry.directions import sweep
from nvsim.graph.connectivity import SUFFIX, write_connectivity
from nvsim.mapping.config import MappingConfig
from tests.benchmarks.harness import timed
from tests.benchmarks.oracle import mapped


@dataclass(frozen=True)
class Arguments:
    out: tyro.conf.Positional[Path]
    seeds: tuple[int, ...] = (101,)
    width: int = 160
    """Width of a view in pixels. Its height is three quarters of that."""


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    for seed in arguments.seeds:
        write = partial(write_scan, arguments.out, seed, arguments.width)
        viewpoints, seconds = timed(write, time.process_time)
        print(f"B{seed}: {viewpoints} viewpoints, {seconds:.0f} s of processor time", flush=True)


def write_scan(out: Path, seed: int, width: int) -> int:
    """Writes a scan and returns its number of viewpoints; 0 if the scan exists already."""
    scan = f"B{seed}"
    if (out / "connectivity" / f"{scan}{SUFFIX}").is_file():
        return 0
    scene = make_scene(BuildingConfig(seed=seed))
    textures = textures_of(scene)
    graph = mapped(occupancy(scene), scene.path[:, :2], MappingConfig(), scan).graph
    nobody = np.empty((0, 5)), np.empty((0, 3))
    for viewpoint in graph.viewpoints.values():
        for i, camera in enumerate(sweep(np.array(viewpoint.position), width, width * 3 // 4)):
            seen = render(camera, scene.solids, textures, *nobody).color
            image = np.rint(255 * np.clip(seen[..., ::-1], 0, 1)).astype(np.uint8)
            jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
            atomic.write_bytes(out / "views" / scan / viewpoint.id / f"{i}.jpg", jpeg)
    write_connectivity(graph, out / "connectivity")
    return len(graph.viewpoints)


if __name__ == "__main__":
    main()
