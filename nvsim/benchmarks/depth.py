"""Measures the cost of depth estimation on a short trajectory through the generated building."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsim.building.config import BuildingConfig
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene, textures_of
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.depth.config import DepthConfig
from nvsim.depth.estimate import estimate_depth
from nvsim.geometry.lens import Lens


def walk(folder: Path, frames: int, building: BuildingConfig) -> Capture:
    """A capture of the first `frames` images of a trajectory, rendered into `folder`, without a LiDAR scan."""
    scene = make_scene(building)
    textures, nobody = textures_of(scene), (np.empty((0, 5)), np.empty((0, 3)))
    taken = []
    for i in range(min(frames, len(scene.walk))):
        camera = scene.camera(i)
        k = camera.intrinsics
        image = np.rint(np.clip(render(camera, scene.solids, textures, *nobody).color, 0, 1) * 255).astype(np.uint8)
        path = folder / f"{i:06d}.png"
        cv2.imwrite(str(path), image[..., ::-1])
        lens = Lens("PINHOLE", k.width, k.height, (k.fx, k.fy, k.cx, k.cy))
        taken.append(Frame(path.name, path, lens, camera.camera_to_world, timestamp=float(i)))
    return Capture(folder, "kapture", tuple(taken), None, Alignment.identity())


def measure(frames: int, config: DepthConfig, building: BuildingConfig | None = None) -> dict[str, Any]:
    """ms_per_frame of the depth stage, including fusion; also frames, size of the depth maps, points of the cloud, and
    threads. A first run at a small size compiles the kernels and is not counted."""
    with tempfile.TemporaryDirectory() as name:
        capture = walk(Path(name), frames, building or BuildingConfig(people=False))
        estimate_depth(capture, Path(name) / "first", replace(config, longest_side=96, planes=16))
        started = time.perf_counter()
        cloud = estimate_depth(capture, Path(name) / "all", config)
        seconds = time.perf_counter() - started
    size = capture.frames[0].intrinsics.limited_to(config.longest_side)
    return {
        "ms_per_frame": round(1e3 * seconds / len(capture.frames), 1),
        "frames": len(capture.frames),
        "size": f"{size.width}x{size.height}",
        "points": len(cloud.points),
        "threads": config.threads,
    }
