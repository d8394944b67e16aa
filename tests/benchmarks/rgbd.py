"""Compare the graph of an RGB-D capture with that of a LiDAR capture: a table and one JSON line.

python tests/benchmarks/rgbd.py FOLDER [--seed N] [--size small] [--noise 0.015] [--width 256] [--scanned PROJECT]

The built-in building is used twice: with its LiDAR scan, and with a depth image for each frame instead of the scan.
--noise is the standard deviation of the depth as a share of the depth. --width is the width of the depth images in
pixels, as for a phone. --scanned names a finished project of this building with its scan, which is then reused.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from harness import nvsim, report
from images_only import scored, without_scan

from nvsim.building import BuildingConfig, generate
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene, textures_of

_FLAT = 0.7  # share of the noise that neighboring pixels have in common, because the depth of a phone is smooth
_BLOCK = 16  # size of a block with common noise, pixels


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    seed: int = 0
    size: str = "small"
    noise: float = 0.0
    width: int = 480
    scanned: Path | None = None


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    config = BuildingConfig(seed=arguments.seed, size=arguments.size)  # type: ignore[arg-type]
    made = arguments.folder / "building"
    generate(made, config)
    map_file, figures = made / "ground_truth" / "map.yaml", dict[str, Any]()
    capture = rgbd_capture(made / "capture", arguments.folder / "rgbd", config, arguments.noise, arguments.width)
    projects = {"scan": arguments.scanned or arguments.folder / "scan.nvsim", "rgbd": arguments.folder / "rgbd.nvsim"}
    for name, source in (("scan", made / "capture"), ("rgbd", capture)):
        if name == "rgbd" or arguments.scanned is None:
            nvsim("run", str(source), "--project", str(projects[name]))
        figures[name] = scored("graph", "--project", str(projects[name]), "--occupancy", str(map_file))
    for key in figures["scan"]:
        print(f"{key:28} {figures['scan'][key]!s:>12} {figures['rgbd'].get(key)!s:>12}")
    report(figures, as_json=True)


def rgbd_capture(capture: Path, folder: Path, config: Any, noise: float, width: int) -> Path:
    """Copies the capture of the built-in building with links to its images, without its scan, and with a depth image in
    millimeters for each frame. The depth has relative noise `noise` and a width of `width` pixels."""
    without_scan(capture, folder)
    (folder / "depth").mkdir(exist_ok=True)
    scene, rng = make_scene(config), np.random.default_rng(1)
    textures = textures_of(scene)
    tree = json.loads((folder / "transforms.json").read_text())
    for number, frame in enumerate(tree["frames"]):
        depth = np.asarray(render(scene.camera(number), scene.solids, textures, *scene.people_in_frame(number)).depth)
        height, size = round(width * depth.shape[0] / depth.shape[1]), depth.shape[1]
        if width != size:
            depth = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST)
        coarse = rng.normal(0, 1, (-(-height // _BLOCK), -(-width // _BLOCK)))
        common = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        off = _FLAT * common + (1 - _FLAT**2) ** 0.5 * rng.normal(0, 1, depth.shape)
        millimeters = np.rint(np.nan_to_num(1000 * depth * (1 + noise * off), posinf=0)).clip(0, 65000)
        name = f"depth/{number:05d}.png"
        cv2.imwrite(str(folder / name), millimeters.astype(np.uint16))
        frame["depth_file_path"] = name
    (folder / "transforms.json").write_text(json.dumps(tree))
    return folder


if __name__ == "__main__":
    main()
