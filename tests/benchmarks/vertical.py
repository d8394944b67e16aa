"""Compare estimates of the vertical of captures whose images have true poses.

python tests/benchmarks/vertical.py CAPTURE [CAPTURE ...] [--up y]

For each capture it prints the error in degrees of three estimates: from the cameras, from the floor of triangulated
points, and from vertical edges in the images. --up names the axis of the capture that points up.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))
from harness import report

from nvsim.capture.alignment import find_up
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import find_floor
from nvsim.capture.read import read_usable
from nvsim.capture.triangulation import image_points
from nvsim.capture.vertical_edges import vertical_from_images


@dataclass(frozen=True)
class Arguments:
    captures: tyro.conf.Positional[tuple[Path, ...]]
    up: Literal["x", "y", "z"] = "z"


def main() -> None:
    a = tyro.cli(Arguments, description=__doc__)
    true = np.eye(3)["xyz".index(a.up)]

    def error(up: NDArray[np.float64] | None) -> float | None:
        return None if up is None else round(float(np.degrees(np.arccos(np.clip(up @ true, -1, 1)))), 2)

    for path in a.captures:
        frames = read_usable(path, "", "", Findings()).frames
        poses = np.array([f.camera_to_world for f in frames if f.camera_to_world is not None])
        cameras, unsure = find_up(poses)
        floor = find_floor(image_points(frames), poses[:, :3, 3], cameras, unsure)
        near = cameras if floor is None else floor.normal
        edges = vertical_from_images(frames, near)
        errors = {"cameras": error(cameras), "floor": error(near) if floor else None, "edges": error(edges)}
        report({"capture": str(path), "images": len(poses), **errors}, as_json=True)


if __name__ == "__main__":
    main()
